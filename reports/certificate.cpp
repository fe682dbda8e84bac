#include "reports/certificate.h"

#include "core/error.h"
#include "core/fields.h"
#include "reports/number.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace fringecal::reports {
namespace {

constexpr std::uintmax_t kLargestFile = 1'000'000;

Fields read_form(const std::filesystem::path& file, const char* schema) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);
  if (!error && size > kLargestFile) {
    throw InputError(fmt::format("{}: {} bytes; such a file has at most {}", file.string(), size, kLargestFile));
  }
  Fields fields(read_toml(file), file.string());
  fields.expect_schema(schema, 1);
  return fields;
}

bool is_day(const std::string& date) {
  static constexpr std::string_view kPattern = "dddd-dd-dd";
  if (date.size() != kPattern.size()) return false;
  for (std::size_t k = 0; k < date.size(); ++k) {
    if (kPattern[k] == 'd' ? date[k] < '0' || date[k] > '9' : date[k] != '-') return false;
  }
  const int month = std::stoi(date.substr(5, 2)), day = std::stoi(date.substr(8, 2));
  return month >= 1 && month <= 12 && day >= 1 && day <= 31;
}

/// A text without white space at its ends (the certificate's XML allows none there).
std::string trimmed(const std::string& text) {
  constexpr const char* kSpace = " \t\r\n";
  const auto from = text.find_first_not_of(kSpace);
  return from == std::string::npos ? "" : text.substr(from, text.find_last_not_of(kSpace) - from + 1);
}

std::string optional(Fields& fields, const char* key) { return trimmed(fields.optional_text(key).value_or("")); }

std::string wanted(Fields& fields, const char* key) {
  std::string text = trimmed(fields.text(key));
  if (text.empty()) fields.complain(fmt::format("{} is empty", key));
  return text;
}

std::string optional_day(Fields& fields, const char* key) {
  std::string day = optional(fields, key);
  if (!day.empty() && !is_day(day))
    fields.complain(fmt::format("{} = \"{}\" is not a day; write 2026-11-30", key, day));
  return day;
}

Address read_address(Fields fields) {
  Address out;
  out.name = wanted(fields, "name");
  out.street = optional(fields, "street");
  out.street_no = optional(fields, "street_no");
  out.post_code = optional(fields, "post_code");
  out.city = wanted(fields, "city");
  out.country_code = wanted(fields, "country_code");
  const auto capital = [](char c) { return c >= 'A' && c <= 'Z'; };
  if (out.country_code.size() != 2 || !std::all_of(out.country_code.begin(), out.country_code.end(), capital)) {
    fields.complain(fmt::format("country_code = \"{}\" is not one of ISO 3166-1; write DE, CH, US", out.country_code));
  }
  out.email = optional(fields, "email");
  out.phone = optional(fields, "phone");
  out.web = optional(fields, "web");
  fields.finish();
  return out;
}

Item read_item(Fields fields) {
  Item out;
  out.name = wanted(fields, "name");
  out.manufacturer = optional(fields, "manufacturer");
  out.model = optional(fields, "model");
  out.serial_number = wanted(fields, "serial_number");
  out.inventory_number = optional(fields, "inventory_number");
  out.condition = optional(fields, "condition");
  out.received = optional_day(fields, "received");
  fields.finish();
  return out;
}

Amendment read_amendment(Fields fields) {
  Amendment out;
  const std::string kind = fields.text("kind");
  if (kind != "amends" && kind != "replaces")
    fields.complain(fmt::format("kind = \"{}\"; known: amends, replaces", kind));
  out.replaces = kind == "replaces";
  out.number = wanted(fields, "number");
  out.reason = optional(fields, "reason");
  fields.finish();
  return out;
}

/// "−2.50 × 10⁻⁶" -> "-2.50E-6".
std::string plain(std::string number) {
  static const std::array<std::pair<std::string, std::string>, 13> kAscii = {{{"\u2212", "-"},
                                                                              {" × 10", "E"},
                                                                              {"⁻", "-"},
                                                                              {"⁰", "0"},
                                                                              {"¹", "1"},
                                                                              {"²", "2"},
                                                                              {"³", "3"},
                                                                              {"⁴", "4"},
                                                                              {"⁵", "5"},
                                                                              {"⁶", "6"},
                                                                              {"⁷", "7"},
                                                                              {"⁸", "8"},
                                                                              {"⁹", "9"}}};
  for (const auto& [what, with] : kAscii) {
    for (auto at = number.find(what); at != std::string::npos; at = number.find(what, at)) {
      number.replace(at, what.size(), with);
    }
  }
  return number;
}

/// How close to its nearest limit, in limits: 1 at a limit.
double closeness(const metrology::Quantity& q) {
  double out = -1;
  if (!q.limits) return out;
  for (const auto& limit : {q.limits->lower, q.limits->upper}) {
    if (limit && *limit != 0) out = std::max(out, q.value / *limit);
  }
  return out;
}

}  // namespace

Laboratory read_laboratory(const std::filesystem::path& file) {
  Fields fields = read_form(file, "fringecal.laboratory");
  Laboratory out;
  out.address = read_address(fields.table("address"));
  out.accreditation = optional(fields, "accreditation");
  out.procedure = optional(fields, "procedure");
  out.time_stamp_server = optional(fields, "time_stamp_server");
  out.test = fields.optional_boolean("test").value_or(false);
  if (auto place = optional(fields, "place"); !place.empty()) out.place = place;
  static constexpr std::array kPlaces = {"laboratory", "customer", "laboratoryBranch", "customerBranch", "other"};
  if (std::find(kPlaces.begin(), kPlaces.end(), out.place) == kPlaces.end()) {
    fields.complain(fmt::format("place = \"{}\"; known: {}", out.place, fmt::join(kPlaces, ", ")));
  }
  for (auto& person : fields.tables("persons")) {
    out.persons.push_back({wanted(person, "name"), optional(person, "role"),
                           person.optional_boolean("main_signer").value_or(out.persons.empty())});
    person.finish();
  }
  if (out.persons.empty()) fields.complain("there is no [[persons]]: a certificate names who authorised it");
  fields.finish();
  return out;
}

Customer read_customer(const std::filesystem::path& file) {
  Fields fields = read_form(file, "fringecal.customer");
  Customer out;
  out.address = read_address(fields.table("address"));
  out.order = optional(fields, "order");
  out.item = read_item(fields.table("item"));
  out.recalibration_date = optional_day(fields, "recalibration_date");
  out.remarks = optional(fields, "remarks");
  if (auto amendment = fields.optional_table("amendment")) out.amendment = read_amendment(*amendment);
  fields.finish();
  return out;
}

Stated stated(double value, double U) {
  const Rounded both = rounded(value, U);
  return {plain(both.value), plain(both.u)};
}

std::string two_digits(double u) { return u > 0 ? stated(u, u).U : "0"; }

std::string exact(double value) { return plain(fmt::format("{}", value)); }

std::vector<ResultLine> result_lines(const Certificate& certificate) {
  std::vector<ResultLine> out;
  for (const auto& record : certificate.records) {
    for (const auto& q : record.verification.quantities) {
      const Stated numbers = stated(q.value, q.uncertainty.U);
      ResultLine line{.number = static_cast<int>(out.size()) + 1,
                      .symbol = q.symbol,
                      .name = q.name,
                      .artefact = q.artefact,
                      .position = q.position,
                      .unit = q.unit,
                      .value = numbers.value,
                      .U = numbers.U,
                      .k = plain(fixed(q.uncertainty.k, 2)),
                      .coverage_percent = plain(without_end_zeros(fixed(100 * q.uncertainty.coverage, 2))),
                      .as_found = record.as_found,
                      .quantity = &q};
      if (q.limits && q.limits->lower) line.lower = exact(*q.limits->lower);
      if (q.limits && q.limits->upper) line.upper = exact(*q.limits->upper);
      if (q.judgement) line.verdict = q.judgement->verdict;
      out.push_back(std::move(line));
    }
  }
  return out;
}

std::vector<ResultLine> lines_with_budget(const std::vector<ResultLine>& lines) {
  std::map<std::string, const ResultLine*> best;
  for (const auto& line : lines) {
    if (line.as_found || line.quantity->budget.empty()) continue;
    const ResultLine*& so_far = best[line.symbol];
    const auto rank = [](const ResultLine& l) { return std::pair(closeness(*l.quantity), l.quantity->uncertainty.U); };
    if (so_far == nullptr || rank(line) > rank(*so_far)) so_far = &line;
  }
  std::vector<ResultLine> out;
  for (const auto& line : lines) {
    const auto found = best.find(line.symbol);
    if (found != best.end() && found->second == &line) out.push_back(line);
  }
  return out;
}

std::string csv_field(const std::string& words) {
  if (words.find_first_of(",\"\r\n") == std::string::npos) return words;
  std::string out = "\"";
  for (const char c : words) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

std::string results_csv(const Certificate& certificate) {
  std::string out = "number,symbol,name,artefact,position,unit,value,U,k,lower_limit,upper_limit,conformity,state\r\n";
  for (const auto& line : result_lines(certificate)) {
    out += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{}\r\n", line.number, csv_field(line.symbol),
                       csv_field(line.name), csv_field(line.artefact), csv_field(line.position), csv_field(line.unit),
                       line.value, line.U, line.k, line.lower.value_or(""), line.upper.value_or(""),
                       line.verdict ? metrology::name_of(*line.verdict) : "", line.as_found ? "as found" : "as left");
  }
  return out;
}

void check(const Certificate& c) {
  if (c.records.empty()) throw InputError("a certificate needs at least one verification record");
  const auto word = [](char x) { return std::isalnum(static_cast<unsigned char>(x)) != 0; };
  if (std::none_of(c.number.begin(), c.number.end(), word) || trimmed(c.number) != c.number || c.number.size() > 80) {
    throw InputError(
        fmt::format("the certificate number \"{}\" will not do: up to 80 letters, digits and signs, no "
                    "space at its ends",
                    c.number.substr(0, 80)));
  }
  for (const auto& record : c.records) {
    const auto& v = record.verification;
    if (v.quantities.empty()) throw InputError(fmt::format("the record of {} has no result to certify", v.scanner));
    if (v.begun.size() < 10 || v.ended.size() < 10 || !is_day(v.begun.substr(0, 10)) ||
        !is_day(v.ended.substr(0, 10)) || v.ended.substr(0, 10) < v.begun.substr(0, 10)) {
      throw InputError(fmt::format("the record of {} was begun \"{}\" and ended \"{}\": these are no dates in order",
                                   v.scanner, v.begun, v.ended));
    }
    if (!c.customer.item.received.empty() && v.begun.substr(0, 10) < c.customer.item.received) {
      throw InputError(
          fmt::format("the item was received on {} and the calibration began on {}: correct [item] received",
                      c.customer.item.received, v.begun.substr(0, 10)));
    }
    if (v.ended > c.issued) {
      throw InputError(fmt::format("the calibration ended {} after the certificate's date {}: the clock is wrong",
                                   v.ended, c.issued));
    }
    for (const auto& q : v.quantities) {
      if (!(q.uncertainty.k >= 1)) {
        throw InputError(fmt::format("{} of {}: a coverage factor of {} cannot be certified; it is 1 or more", q.symbol,
                                     q.artefact, q.uncertainty.k));
      }
    }
  }
}

}  // namespace fringecal::reports
