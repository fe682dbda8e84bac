// data.zip, what lies beside a certificate for whoever wants to compute with it:
//   contents.json             "fringecal.certificate-data", version 1: number, date, and each file with size and SHA-256
//   results.csv               results_csv()
//   results.json              "fringecal.certificate-results", version 1: the same lines, numbers as printed
//   verification-N.json       the N-th record, byte for byte
//   history.csv               results of the item that the history holds, where the certificate is issued from one
//   figures/NAME.svg          the certificate's figures
//   record-N/clouds/*.ply     residual clouds of the N-th record (metrology/residual_cloud.h), as far as they were there
// The same content and date of issue give the same bytes. Its SHA-256 stands in the certificate, which is signed.
#pragma once

#include "reports/certificate.h"

#include <string>
#include <vector>

namespace fringecal::reports {

std::string certificate_data(const Certificate& certificate, const std::vector<ArchiveFile>& figures);

/// Figures as files: "figures/limits-1.svg", "figures/volume-1.svg", ...
std::vector<ArchiveFile> figure_files(const Certificate& certificate);

}  // namespace fringecal::reports
