// fringecal report RECORD...: a verification report, HTML and PDF: everything of a certificate but its authority.
#include "cli/commands.h"
#include "cli/records.h"
#include "core/file.h"
#include "core/value.h"
#include "reports/archival_pdf.h"
#include "reports/certificate_html.h"

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

void run(const ReportArguments& arguments) {
  reports::Certificate report;
  report.is_report = true;
  report.language = arguments.language;
  report.records = read_records(arguments.records, arguments.history);
  const auto& first = report.records.front().verification;
  report.number = fmt::format("{} {}", first.scanner, first.ended);
  report.issued = utc_now();
  reports::check(report);
  const std::string html = reports::certificate_html(report);
  const std::string title = reports::Catalogue::in(arguments.language)("title.report") + " " + report.number;
  FolderTransaction folder(arguments.output);
  write_atomically(folder.working() / "report.html", html);
  if (!arguments.html_only) {
    write_atomically(folder.working() / "report.pdf", reports::archival_pdf(html, {title, "fringecal", report.issued}));
  }
  write_atomically(folder.working() / "results.csv", reports::results_csv(report));
  folder.commit();
  const std::size_t n = reports::result_lines(report).size();
  if (arguments.json) {
    fmt::print("{}", to_json(Value::object().set("folder", arguments.output).set("results", n)));
  } else {
    fmt::print("Report in {}: {} results\n", arguments.output, n);
  }
}

}  // namespace

void add_report(CLI::App& app) {
  auto arguments = std::make_shared<ReportArguments>();
  CLI::App* report =
      app.add_subcommand("report", "Writes a verification report (HTML and PDF), short of a certificate");
  report->add_option("record", arguments->records, "verification records: files, or with --history numbers of entries")
      ->required();
  report->add_option("--history", arguments->history, "history that the records are taken from");
  report->add_option("--language", arguments->language, "language of the texts: en (default) or de");
  report->add_flag("--html-only", arguments->html_only, "no PDF (does not need WeasyPrint)");
  report->add_option("-o,--output", arguments->output, "folder to write")->required();
  report->add_flag("--json", arguments->json, "print JSON");
  report->footer("Example: fringecal report verification.json -o report");
  report->callback([arguments] { run(*arguments); });
}

}  // namespace fringecal::cli
