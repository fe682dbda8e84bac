#include "reports/certificate_data.h"

#include "core/file.h"
#include "reports/certificate_figures.h"
#include "reports/limit_figure.h"

#include <fmt/format.h>

#include <cstdlib>
#include <map>

namespace fringecal::reports {
namespace {

/// A printed number as a number.
double number_of(const std::string& printed) { return std::strtod(printed.c_str(), nullptr); }

std::string results_json(const Certificate& c) {
  Value lines = Value::array();
  for (const auto& line : result_lines(c)) {
    Value one = Value::object()
                    .set("number", line.number)
                    .set("symbol", line.symbol)
                    .set("name", line.name)
                    .set("artefact", line.artefact)
                    .set("position", line.position)
                    .set("unit", line.unit)
                    .set("value", number_of(line.value))
                    .set("U", number_of(line.U))
                    .set("k", number_of(line.k))
                    .set("coverage_percent", number_of(line.coverage_percent));
    if (line.lower) one.set("lower_limit", number_of(*line.lower));
    if (line.upper) one.set("upper_limit", number_of(*line.upper));
    if (line.verdict) one.set("conformity", metrology::name_of(*line.verdict));
    lines.append(one.set("state", line.as_found ? "as found" : "as left"));
  }
  return to_json(Value::object()
                     .set("schema", "fringecal.certificate-results")
                     .set("schema_version", 1)
                     .set("number", c.number)
                     .set("results", lines));
}

std::string history_csv(const Certificate& c) {
  std::string out = "entry,date,kind,symbol,artefact,position,unit,value,U,lower_limit,upper_limit\r\n";
  const auto number = [](const std::optional<double>& x) { return x ? exact(*x) : std::string(); };
  for (const auto& r : c.past) {
    out += fmt::format("{},{},{},{},{},{},{},{},{},{},{}\r\n", r.entry, r.date, csv_field(r.kind), csv_field(r.symbol),
                       csv_field(r.artefact), csv_field(r.position), csv_field(r.unit), exact(r.value), number(r.U),
                       r.limits ? number(r.limits->lower) : "", r.limits ? number(r.limits->upper) : "");
  }
  return out;
}

}  // namespace

std::vector<ArchiveFile> figure_files(const Certificate& c) {
  std::vector<ArchiveFile> out;
  std::map<std::string, int> numbers;
  const auto add = [&](const std::string& name, const Markup& picture) {
    out.push_back({fmt::format("figures/{}-{}.svg", name, ++numbers[name]), picture.html() + "\n"});
  };
  for (const auto& picture : limit_figures(result_lines(c))) add("limits", picture);
  for (const auto& figure : certificate_figures(c, Catalogue::in(c.language))) add(figure.name, figure.picture);
  return out;
}

std::string certificate_data(const Certificate& c, const std::vector<ArchiveFile>& figures) {
  std::vector<ArchiveFile> files = {{"results.csv", results_csv(c)}, {"results.json", results_json(c)}};
  if (!c.past.empty()) files.push_back({"history.csv", history_csv(c)});
  for (std::size_t k = 0; k < c.records.size(); ++k) {
    files.push_back({fmt::format("verification-{}.json", k + 1), c.records[k].document});
  }
  files.insert(files.end(), figures.begin(), figures.end());
  for (std::size_t k = 0; k < c.records.size(); ++k) {
    for (const auto& cloud : c.records[k].clouds) {
      files.push_back({fmt::format("record-{}/{}", k + 1, cloud.name), cloud.bytes});
    }
  }
  Value list = Value::array();
  for (const auto& file : files) {
    list.append(
        Value::object().set("name", file.name).set("bytes", file.bytes.size()).set("sha256", sha256_hex(file.bytes)));
  }
  files.insert(files.begin(), {"contents.json", to_json(Value::object()
                                                            .set("schema", "fringecal.certificate-data")
                                                            .set("schema_version", 1)
                                                            .set("number", c.number)
                                                            .set("issued", c.issued)
                                                            .set("files", list))});
  return zip_archive(files, c.issued);
}

}  // namespace fringecal::reports
