// fringecal certify RECORD... --lab lab.toml --customer customer.toml --number N: a calibration certificate as a folder.
#include "cli/commands.h"
#include "cli/records.h"
#include "core/error.h"
#include "core/file.h"
#include "reports/archival_pdf.h"
#include "reports/certificate_dcc.h"
#include "reports/certificate_html.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

namespace fringecal::cli {
namespace {

struct CertifyArguments {
  std::vector<std::string> records, as_found;
  std::string history, lab, customer, number, language = "en", output;
  bool json = false;
};

reports::Certificate certificate_of(const CertifyArguments& arguments) {
  reports::Certificate c;
  c.number = arguments.number;
  c.language = arguments.language;
  c.issued = utc_now();
  c.laboratory = reports::read_laboratory(arguments.lab);
  c.customer = reports::read_customer(arguments.customer);
  c.records = read_records(arguments.as_found, arguments.history);
  for (auto& record : c.records) record.as_found = true;
  for (auto& record : read_records(arguments.records, arguments.history)) c.records.push_back(std::move(record));
  reports::check(c);
  return c;
}

void run(const CertifyArguments& arguments) {
  reports::Certificate certificate = certificate_of(arguments);
  const std::string xml = reports::certificate_dcc(certificate);
  const std::string html = reports::certificate_html(certificate);
  const std::string title = reports::Catalogue::in(certificate.language)("title.certificate") + " " + certificate.number;
  const std::string pdf = reports::archival_pdf(html, {title, certificate.laboratory.address.name, certificate.issued},
                                                reports::PdfAttachment{"certificate.xml", "application/xml", title, xml});
  FolderTransaction folder(arguments.output);
  write_atomically(folder.working() / "certificate.html", html);
  write_atomically(folder.working() / "certificate.pdf", pdf);
  write_atomically(folder.working() / "certificate.xml", xml);
  folder.commit();
  fmt::print("Certificate {} in {}\n", certificate.number, arguments.output);
}

}  // namespace

void add_certify(CLI::App& app) {
  auto arguments = std::make_shared<CertifyArguments>();
  CLI::App* certify = app.add_subcommand("certify", "Issues a calibration certificate: PDF, HTML and signed XML (DCC)");
  certify->add_option("record", arguments->records, "verification records: files, or with --history numbers of entries")
      ->required();
  certify->add_option("--as-found", arguments->as_found, "records of the state before adjustment");
  certify->add_option("--history", arguments->history, "history that the records are taken from");
  certify->add_option("--lab", arguments->lab, "who certifies (lab.toml)")->required();
  certify->add_option("--customer", arguments->customer, "for whom, and which item (customer.toml)")->required();
  certify->add_option("--number", arguments->number, "number of the certificate, unique in the laboratory")->required();
  certify->add_option("--language", arguments->language, "language of the texts: en (default) or de");
  certify->add_option("-o,--output", arguments->output, "folder to write")->required();
  certify->footer("Example: fringecal certify verification.json --lab lab.toml --customer customer.toml --number K-2026-17 "
                  "--key key.pem -o K-2026-17");
  certify->callback([arguments] { run(*arguments); });
}

}  // namespace fringecal::cli
