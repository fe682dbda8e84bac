// The parts of a certificate after its first page: results with their figure, method, conditions, traceability, budgets.
#include "reports/certificate_figures.h"
#include "reports/certificate_html.h"
#include "reports/limit_figure.h"
#include "reports/number.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

namespace fringecal::reports {
namespace {

std::string limits_text(const ResultLine& line, const Catalogue& words) {
  if (line.lower && line.upper) {
    return words("results.between", {{"lower", shown(*line.lower)}, {"upper", shown(*line.upper, line.unit)}});
  }
  if (line.upper) return words("results.at_most", {{"limit", shown(*line.upper, line.unit)}});
  if (line.lower) return words("results.at_least", {{"limit", shown(*line.lower, line.unit)}});
  return words("results.limit_none");
}

/// Short identifiers are not broken; long ones may be.
Markup unbroken(const std::string& words) {
  constexpr std::size_t kShort = 20;
  return words.size() <= kShort ? element("span", {{"class", "unbroken"}}, text(words)) : text(words);
}

/// "3" says nothing by itself; "3, mean of 3" has a number and a name.
std::string position_text(const ResultLine& line, const Catalogue& words) {
  const auto end = std::min(line.position.find_first_not_of("0123456789"), line.position.size());
  const std::string number = line.position.substr(0, end), rest = line.position.substr(end);
  if (number.empty()) return words.name(line.position);
  if (rest.empty()) return words("results.position") + " " + number;
  return rest.starts_with(", ") ? words("results.position") + " " + number + ", " + words.name(rest.substr(2))
                                : line.position;
}

Markup verdict_cell(const ResultLine& line, const Catalogue& words) {
  if (!line.verdict) return text("\u2013");
  std::string name = name_of(*line.verdict);
  std::replace(name.begin(), name.end(), ' ', '_');
  const bool good = *line.verdict == metrology::Verdict::pass || *line.verdict == metrology::Verdict::conditional_pass;
  const bool open = *line.verdict == metrology::Verdict::not_proved;
  return element("span", {{"class", good ? "good" : open ? "open" : "bad"}}, text(words("conformity." + name)));
}

Markup results_table(const std::vector<ResultLine>& lines, const Catalogue& words) {
  std::vector<std::vector<Markup>> rows;
  rows.reserve(lines.size());
  for (const auto& line : lines) {
    rows.push_back(
        {text(std::to_string(line.number)),
         element("b", text(line.symbol)) + text(" ") + element("span", {{"class", "sub"}}, text(words.name(line.name))),
         unbroken(line.artefact) + element("span", {{"class", "sub"}}, text(position_text(line, words))),
         text(shown(line.value, line.unit)), text(shown(line.U, line.unit)), text(line.k),
         element("span", {{"class", "unbroken"}}, text(limits_text(line, words))), verdict_cell(line, words)});
  }
  return table("results",
               {{words("results.line"), "", ""},
                {words("results.quantity"), "", ""},
                {words("results.artefact"), "", ""},
                {words("results.value"), "number", ""},
                {words("results.U"), "number", ""},
                {words("results.k"), "number", ""},
                {words("results.limit"), "", ""},
                {words("results.verdict"), "", ""}},
               rows);
}

Markup paragraph(const std::string& name, const std::string& words) {
  return words.empty() ? Markup() : element("p", element("b", text(name + ": ")) + text(words));
}

Markup list_of(const std::vector<std::string>& lines) {
  Markup out;
  for (const auto& line : lines) out += element("li", text(line));
  return element("ul", out);
}

Markup method(const Certificate& c, const Catalogue& words) {
  Markup out = element("h2", text(words("method.heading"))) + element("p", text(words("method.geometry")));
  out += paragraph(words("method.procedure"), c.laboratory.procedure);
  std::set<std::string> plans;
  for (const auto& record : c.records) {
    const auto& v = record.verification;
    if (!plans.insert(v.plan).second) continue;
    out += paragraph(words("method.plan"), v.plan) + paragraph(words("method.source"), v.plan_source);
    if (!v.plan_unchecked.empty()) {
      out += element("p", element("b", text(words("method.unchecked") + ":"))) + list_of(v.plan_unchecked);
    }
    out += element(
        "p", text(words("method.software", {{"program", v.provenance.program}, {"version", v.provenance.version}})));
  }
  std::vector<std::string> deviations;
  for (const auto& record : c.records) {
    deviations.insert(deviations.end(), record.verification.deviations.begin(), record.verification.deviations.end());
  }
  out += paragraph(words("method.deviations"), deviations.empty() ? words("method.none") : " ");
  if (!deviations.empty()) out += list_of(deviations);
  return element("section", out);
}

Markup conditions(const Certificate& c, const Catalogue& words) {
  Markup rows;
  std::set<std::string> seen;  // records of one day often share them
  for (const auto& record : c.records) {
    const auto& e = record.verification.environment;
    Markup row = element("b", text(words("conditions.temperature") + ": ")) + text(temperature_text(e, words));
    if (e.humidity_percent) {
      row += element("br", {}, {}) + element("b", text(words("conditions.humidity") + ": ")) +
             text(shown(exact(*e.humidity_percent), "%"));
    }
    if (seen.insert(row.html()).second) rows += element("p", row);
  }
  return element("section", element("h2", text(words("conditions.heading"))) + rows);
}

Markup traceability(const Certificate& c, const Catalogue& words) {
  std::vector<std::vector<Markup>> rows;
  std::set<std::string> seen;
  for (const auto& record : c.records) {
    for (const auto& a : record.verification.artefacts) {
      if (!seen.insert(a.name + "\n" + a.certificate).second) continue;
      Markup values;
      for (const auto& v : a.values) {
        const Stated s = stated(v.value_mm, v.U_mm);
        if (!values.empty()) values += element("br", {}, {});
        values += text(
            fmt::format("{}: {} ± {}, k = {}", words.name(v.name), shown(s.value, "mm"), shown(s.U, "mm"), exact(v.k)));
      }
      Markup until = unbroken(a.valid_until);
      if (a.expired_accepted) until += element("span", {{"class", "sub"}}, text(words("traceability.expired")));
      rows.push_back({unbroken(a.name) + element("span", {{"class", "sub"}}, text(words.name(a.kind))), values,
                      unbroken(a.certificate), unbroken(a.laboratory), unbroken(a.date), until});
    }
  }
  if (rows.empty()) return {};
  return element("section", element("h2", text(words("traceability.heading"))) +
                                element("p", text(words("traceability.statement"))) +
                                table("small",
                                      {{words("traceability.artefact"), "", ""},
                                       {words("traceability.certified"), "", ""},
                                       {words("traceability.certificate"), "", ""},
                                       {words("traceability.laboratory"), "", ""},
                                       {words("traceability.date"), "", ""},
                                       {words("traceability.valid_until"), "", ""}},
                                      rows));
}

/// One row per contribution, one column per line of the results: budgets of one test are alike.
Markup budget_table(const std::vector<ResultLine>& lines, const Catalogue& words) {
  using Row = std::pair<std::string, metrology::Evaluation>;
  std::vector<Row> names;
  for (const auto& line : lines) {
    for (const auto& c : line.quantity->budget) {
      if (std::find(names.begin(), names.end(), Row(c.name, c.evaluation)) == names.end()) {
        names.emplace_back(c.name, c.evaluation);
      }
    }
  }
  std::vector<Column> columns = {{words("uncertainty.contribution"), "", ""}, {words("uncertainty.kind"), "", ""}};
  for (const auto& line : lines) {
    columns.push_back({fmt::format("{}, {} {}", line.symbol, words("results.line"), line.number), "number", ""});
  }
  std::vector<std::vector<Markup>> rows;
  for (const auto& [name, evaluation] : names) {
    std::vector<Markup> row = {text(words.name(name)), text(evaluation == metrology::Evaluation::type_a ? "A" : "B")};
    for (const auto& line : lines) {
      Markup cell;
      for (const auto& c : line.quantity->budget) {
        if (c.name != name || c.evaluation != evaluation) continue;
        if (!cell.empty()) cell += element("br", {}, {});
        cell += text(shown(two_digits(c.u_of_quantity()), line.unit));
      }
      row.push_back(cell.empty() ? text("\u2013") : cell);
    }
    rows.push_back(std::move(row));
  }
  std::vector<Markup> sum = {element("b", text(words("uncertainty.combined"))), Markup()};
  for (const auto& line : lines) {
    sum.push_back(element("b", text(shown(two_digits(line.quantity->uncertainty.u), line.unit))));
  }
  rows.push_back(std::move(sum));
  return element("div", {{"class", "keep"}}, table("small", columns, rows));
}

Markup budgets(const Certificate& c, const Catalogue& words) {
  const auto lines = lines_with_budget(result_lines(c));
  if (lines.empty()) return {};
  constexpr std::size_t kColumns = 5;  // as many as A4 has room for
  Markup out = element("h3", text(words("uncertainty.budget")));
  for (std::size_t k = 0; k < lines.size(); k += kColumns) {
    const auto end = lines.begin() + static_cast<std::ptrdiff_t>(std::min(lines.size(), k + kColumns));
    out += budget_table({lines.begin() + static_cast<std::ptrdiff_t>(k), end}, words);
  }
  return out;
}

Markup remarks(const Certificate& c, const Catalogue& words) {
  Markup out = element("h2", text(words("remarks.heading"))) + element("p", text(words("remarks.item_only")));
  if (!c.is_report) {
    out += element("p", text(words("remarks.reproduction")));
    if (!c.customer.recalibration_date.empty()) {
      out += element("p", text(words("remarks.recalibration", {{"date", c.customer.recalibration_date}})));
    }
    out += element("p", text(words(c.signer ? "remarks.machine" : "remarks.machine_unsigned")));
  }
  if (!c.customer.remarks.empty()) out += element("p", {{"class", "free"}}, text(c.customer.remarks));
  Markup origin;
  int number = 0;
  for (const auto& record : c.records) {
    origin += element("p", {{"class", "hash"}},
                      text(words("remarks.record", {{"line", std::to_string(++number)}}) + " " + record.sha256));
    if (record.entry) {
      origin += element(
          "p", {{"class", "hash"}},
          text(words("remarks.history", {{"number", std::to_string(*record.entry)}}) + " " + record.entry_hash));
    }
  }
  if (!c.data_sha256.empty()) {
    origin += element("p", {{"class", "hash"}}, text(words("remarks.data") + " " + c.data_sha256));
  }
  return element("section", out) + element("section", element("h2", text(words("remarks.origin"))) + origin);
}

}  // namespace

Markup certificate_results(const Certificate& c, const Catalogue& words) {
  const std::vector<ResultLine> all = result_lines(c);
  std::vector<ResultLine> found, left;
  for (const auto& line : all) (line.as_found ? found : left).push_back(line);
  Markup out = element("h2", text(words("results.heading")));
  if (!found.empty()) {
    out += element("p", text(words("results.adjusted")));
    out += element("h3", text(words("results.as_found"))) + results_table(found, words);
    out += element("h3", text(words("results.as_left")));
  }
  if (!left.empty()) out += results_table(left, words);
  for (const auto& picture : limit_figures(all)) out += figure("wide", picture, words("results.figure"));
  for (const auto& one : certificate_figures(c, words)) out += figure("wide", one.picture, one.caption);
  Markup uncertainty = element("h2", text(words("uncertainty.heading")));
  std::set<std::string> coverages;
  for (const auto& line : all) {
    if (coverages.insert(line.coverage_percent).second) {
      uncertainty += element("p", text(words("uncertainty.statement", {{"coverage", line.coverage_percent}})));
    }
  }
  return element("section", {{"class", "new-page"}}, out) + element("section", uncertainty + budgets(c, words));
}

Markup certificate_annex(const Certificate& c, const Catalogue& words) {
  return method(c, words) + conditions(c, words) + traceability(c, words) + remarks(c, words);
}

}  // namespace fringecal::reports
