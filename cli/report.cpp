// fringecal report RECORD...: a report, HTML and PDF, short of a certificate: of verifications, of a calibration
// (scanner.json) or of an alignment (its record).
#include "cli/commands.h"
#include "cli/records.h"
#include "core/error.h"
#include "core/file.h"
#include "core/value.h"
#include "reports/archival_pdf.h"
#include "reports/certificate_html.h"
#include "reports/instrument_report.h"

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

namespace fringecal::cli {
namespace {

struct ReportArguments {
  std::vector<std::string> records;
  std::string history, language = "en", output;
  bool html_only = false, json = false;
};

/// Report, PDF and what more there is, as a folder; the line for people or programs.
struct Written {
  std::string html, title;
  std::size_t results = 0;
  std::vector<reports::ArchiveFile> more = {};
};

void write(const ReportArguments& arguments, const Written& report) {
  FolderTransaction folder(arguments.output);
  write_atomically(folder.working() / "report.html", report.html);
  if (!arguments.html_only) {
    write_atomically(folder.working() / "report.pdf",
                     reports::archival_pdf(report.html, {report.title, "fringecal", utc_now()}));
  }
  for (const auto& file : report.more) write_atomically(folder.working() / file.name, file.bytes);
  folder.commit();
  if (arguments.json) {
    fmt::print(
        "{}",
        to_json(
            Value::object().set("folder", arguments.output).set("title", report.title).set("results", report.results)));
  } else {
    fmt::print("{} in {}: {} results\n", report.title, arguments.output, report.results);
  }
}

Written verification_report(const ReportArguments& arguments) {
  reports::Certificate report;
  report.is_report = true;
  report.language = arguments.language;
  report.records = read_records(arguments.records, arguments.history);
  const auto& first = report.records.front().verification;
  report.number = fmt::format("{} {}", first.scanner, first.ended);
  report.issued = utc_now();
  if (!arguments.history.empty()) {
    report.past = read_past(arguments.history, first.scanner, report.issued);
  } else {
    take_clouds_beside(report.records, {}, arguments.records);
  }
  reports::check(report);
  return {reports::certificate_html(report),
          reports::Catalogue::in(arguments.language)("title.report") + " " + report.number,
          reports::result_lines(report).size(),
          {{"results.csv", reports::results_csv(report)}}};
}

/// What a file is, by its schema.
std::string schema_of(const std::string& file) {
  const Value document = read_json(file);
  const Value* schema = document.find("schema");
  return schema == nullptr || schema->if_text() == nullptr ? "" : *schema->if_text();
}

void run(const ReportArguments& arguments) {
  const std::string& file = arguments.records.front();
  const std::string schema = arguments.history.empty() ? schema_of(file) : "";
  const bool is_alignment = schema == "fringecal.alignment_record";
  if (schema != "fringecal.scanner" && !is_alignment) return write(arguments, verification_report(arguments));
  if (arguments.records.size() > 1) {
    throw InputError(fmt::format("{}: a report is of one calibration or one alignment, or of verifications", file));
  }
  const std::string hash = sha256_of_file(file);
  const auto report = is_alignment ? reports::alignment_report(read_json(file), file, hash, arguments.language)
                                   : reports::calibration_report(model::read_scanner(file), hash, arguments.language);
  write(arguments, {report.html, report.title, report.results});
}

}  // namespace

void add_report(CLI::App& app) {
  auto arguments = std::make_shared<ReportArguments>();
  CLI::App* report = app.add_subcommand(
      "report",
      "Writes a report of verifications, of a calibration or of an alignment (HTML and PDF), short of a certificate");
  report
      ->add_option(
          "record", arguments->records,
          "verification records: files, or with --history numbers of entries; or a scanner.json, or the record of an "
          "alignment")
      ->required();
  report->add_option("--history", arguments->history, "history that the records are taken from");
  report->add_option("--language", arguments->language, "language of the texts: en (default) or de");
  report->add_flag("--html-only", arguments->html_only, "no PDF (does not need WeasyPrint)");
  report->add_option("-o,--output", arguments->output, "folder to write")->required();
  report->add_flag("--json", arguments->json, "print JSON");
  report->footer(
      "Examples:\n  fringecal report verification.json -o report\n  fringecal report scanner.json -o "
      "calibration-report\n"
      "  fringecal report commissioning/alignment/record.json -o alignment-report");
  report->callback([arguments] { run(*arguments); });
}

}  // namespace fringecal::cli
