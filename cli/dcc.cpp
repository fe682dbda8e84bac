// fringecal dcc read CERTIFICATE: an artefact's own digital certificate becomes an entry of artefacts.toml.
#include "cli/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "core/value.h"
#include "reports/artefact_certificate.h"
#include "reports/xml_document.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

namespace fringecal::cli {
namespace {

struct DccArguments {
  std::string certificate, output;
  reports::ArtefactEntry entry;
  bool json = false;
};

void print_json(const reports::ArtefactCertificate& certificate) {
  Value lengths = Value::array();
  for (const auto& one : certificate.lengths) {
    Value row = Value::object().set("name", one.name).set("ref_type", one.ref_type).set("value_mm", one.value_mm);
    if (one.U_mm) row.set("U_mm", *one.U_mm).set("k", one.k.value_or(""));
    lengths.append(row);
  }
  fmt::print("{}", to_json(Value::object()
                               .set("item", certificate.item)
                               .set("serial_number", certificate.serial_number)
                               .set("certificate", certificate.certificate)
                               .set("laboratory", certificate.laboratory)
                               .set("date", certificate.date)
                               .set("recalibration_date", certificate.recalibration_date)
                               .set("lengths", lengths)));
}

void run(const DccArguments& arguments) {
  const auto document =
      reports::XmlDocument::parse(reports::read_xml_bytes(arguments.certificate), arguments.certificate);
  const auto certificate = reports::artefact_certificate(document, arguments.certificate);
  if (arguments.json) return print_json(certificate);
  const std::string file = std::filesystem::path(arguments.certificate).filename().string();
  const std::string entry = reports::artefact_toml(certificate, arguments.entry, file);
  if (arguments.output.empty()) {
    fmt::print("{}", entry);
    return;
  }
  const bool is_new = !std::filesystem::exists(arguments.output);
  const std::string before =
      is_new ? "schema = \"fringecal.artefacts\"\nschema_version = 1\n" : read_bytes(arguments.output);
  parse_toml(before + entry, arguments.output);
  write_atomically(arguments.output, before + entry);
  fmt::print("{} of certificate {} is in {}\n", arguments.entry.kind, certificate.certificate, arguments.output);
}

}  // namespace

void add_dcc(CLI::App& app) {
  CLI::App* dcc = app.add_subcommand("dcc", "Reads digital calibration certificates of artefacts");
  dcc->require_subcommand(1);
  auto arguments = std::make_shared<DccArguments>();
  CLI::App* read = dcc->add_subcommand(
      "read", "Takes an artefact's certified lengths, uncertainties and traceability into artefacts.toml");
  read->add_option("certificate", arguments->certificate,
                   "the artefact's certificate (DCC, XML); its signature: fringecal check")
      ->required();
  read->add_option("--kind", arguments->entry.kind, "sphere (default), ball_bar, flat or cylinder")
      ->default_val("sphere")
      ->check(CLI::IsMember({"sphere", "ball_bar", "flat", "cylinder"}));
  read->add_option("--name", arguments->entry.name, "name in artefacts.toml; else the item's name in the certificate");
  read->add_option("--valid-until", arguments->entry.valid_until,
                   "day until which the certificate may be used; else the certificate's date of recalibration");
  read->add_option("--expansion-per-k", arguments->entry.expansion_per_K,
                   "linear expansion coefficient of the artefact, 1/K");
  read->add_option("--u-expansion-per-k", arguments->entry.u_expansion_per_K, "its standard uncertainty, 1/K");
  read->add_option("-o,--output", arguments->output,
                   "artefacts.toml to append to, or to begin; else the entry is printed");
  read->add_flag("--json", arguments->json, "print everything that was found as JSON");
  read->footer("Example: fringecal dcc read K-2026-0815.xml --kind sphere --expansion-per-k 11.5e-6 -o artefacts.toml");
  read->callback([arguments] { run(*arguments); });
}

}  // namespace fringecal::cli
