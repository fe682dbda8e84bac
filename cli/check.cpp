// fringecal check CERTIFICATE: is it what its laboratory signed, and does it say the same everywhere?
#include "cli/commands.h"
#include "cli/records.h"
#include "core/error.h"
#include "core/file.h"
#include "core/value.h"
#include "reports/certificate_check.h"
#include "reports/xml_document.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::cli {
namespace {

struct CheckArguments {
  std::string certificate, schema_dir, history;
  std::vector<std::string> trust, trust_stamps;
  bool any_signer = false, json = false;
};

void run(const CheckArguments& arguments) {
  namespace fs = std::filesystem;
  fs::path xml = arguments.certificate;
  const bool is_folder = fs::is_directory(xml);
  if (is_folder) xml /= "certificate.xml";
  reports::CheckRequest request{.xml = reports::read_xml_bytes(xml), .xml_name = xml.string()};
  request.is_folder = is_folder;
  if (is_folder) {
    const fs::path pdf = fs::path(arguments.certificate) / "certificate.pdf", signature = pdf.string() + ".p7s";
    request.pdf = read_bytes(pdf);
    if (fs::exists(signature)) request.pdf_signature = read_bytes(signature);
    const fs::path data = fs::path(arguments.certificate) / "data.zip";
    if (fs::exists(data)) request.data = read_bytes(data);
  }
  const auto stamp = [](const fs::path& file) {
    const fs::path response = file.string() + ".tsr";
    return fs::exists(response) ? std::optional(reports::read_xml_bytes(response)) : std::nullopt;
  };
  request.xml_stamp = stamp(xml);
  if (is_folder) request.pdf_stamp = stamp(fs::path(arguments.certificate) / "certificate.pdf");
  request.trusted_stampers.assign(arguments.trust_stamps.begin(), arguments.trust_stamps.end());
  if (!arguments.schema_dir.empty()) request.schema = schema_in(arguments.schema_dir);
  if (!arguments.history.empty()) request.history = arguments.history;
  request.trusted.assign(arguments.trust.begin(), arguments.trust.end());
  request.any_signer = arguments.any_signer;
  const auto verdict = reports::check_certificate(request);
  if (arguments.json) {
    Value passed = Value::array();
    for (const auto& line : verdict.passed) passed.append(line);
    Value out = Value::object()
                    .set("certificate", arguments.certificate)
                    .set("valid", verdict.fault.empty())
                    .set("passed", passed);
    if (!verdict.fault.empty()) out.set("fault", verdict.fault);
    fmt::print("{}", to_json(out));
  } else {
    for (const auto& line : verdict.passed) fmt::print("  {}\n", line);
  }
  std::fflush(stdout);
  if (!verdict.fault.empty()) throw InputError(fmt::format("{}: {}", arguments.certificate, verdict.fault));
  if (!arguments.json) fmt::print("{}: nothing wrong\n", arguments.certificate);
}

}  // namespace

void add_check(CLI::App& app) {
  auto arguments = std::make_shared<CheckArguments>();
  CLI::App* check =
      app.add_subcommand("check", "Checks a certificate: schema, signature, PDF against XML, results, history");
  check->add_option("certificate", arguments->certificate, "folder of a certificate, or an XML file alone")->required();
  check->add_option("--trust", arguments->trust, "PEM files with certificates that are trusted to sign");
  check->add_option("--trust-timestamp", arguments->trust_stamps,
                    "PEM files with certificates that are trusted to stamp the time");
  check->add_flag("--any-signer", arguments->any_signer,
                  "judge integrity only: an unsigned certificate, or one signed by anybody, is no fault");
  check->add_option("--schema-dir", arguments->schema_dir,
                    "folder with PTB's schemas (v3.3.0/dcc.xsd and what it imports)");
  check->add_option("--history", arguments->history, "history that the results must follow from");
  check->add_flag("--json", arguments->json, "print JSON");
  check->footer("Example: fringecal check K-2026-17 --trust laboratory.pem --schema-dir dcc-schema");
  check->callback([arguments] { run(*arguments); });
}

}  // namespace fringecal::cli
