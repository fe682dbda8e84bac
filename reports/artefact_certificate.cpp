#include "reports/artefact_certificate.h"

#include "core/error.h"
#include "core/value.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <sstream>

namespace fringecal::reports {
namespace {

/// Powers of ten to millimetres; nothing where it is not a length.
std::optional<int> places_to_mm(std::string unit) {
  std::erase_if(unit, [](char c) { return c == ' ' || c == '\n' || c == '\t' || c == '\r'; });
  static constexpr std::array<std::pair<const char*, int>, 7> kPrefixes = {
      {{"", 3}, {"\\milli", 0}, {"\\micro", -3}, {"\\nano", -6}, {"\\centi", 1}, {"\\deci", 2}, {"\\kilo", 6}}};
  for (const auto& [prefix, places] : kPrefixes) {
    if (unit == std::string(prefix) + "\\metre") return places;
  }
  return std::nullopt;
}

std::vector<std::string> items(const std::string& list) {
  std::istringstream in(list);
  std::vector<std::string> out;
  for (std::string one; in >> one;) out.push_back(one);
  return out;
}

/// The item of a list that belongs to entry i; one item stands for all.
std::optional<std::string> at(const std::vector<std::string>& list, std::size_t i) {
  if (list.empty()) return std::nullopt;
  return list[list.size() == 1 ? 0 : std::min(i, list.size() - 1)];
}

std::string first_text(const XmlNode& node, std::initializer_list<const char*> names) {
  for (const char* name : names) {
    const auto found = node.below(name);
    if (!found.empty()) return found.front().text();
  }
  return "";
}

/// si:real, or with the endings of its elements si:realListXMLList.
void read_lengths(const XmlNode& number, const std::string& list, CertifiedLength like,
                  std::vector<CertifiedLength>& out) {
  const auto values = items(number.text_of("value" + list)), units = items(number.text_of("unit" + list));
  const auto expanded = items(first_text(
      number, list.empty() ? std::initializer_list<const char*>{"valueExpandedMU", "uncertainty"}
                           : std::initializer_list<const char*>{"valueExpandedMUXMLList", "uncertaintyXMLList"}));
  const auto factors =
      items(first_text(number, list.empty() ? std::initializer_list<const char*>{"coverageFactor"}
                                            : std::initializer_list<const char*>{"coverageFactorXMLList"}));
  const auto standard = items(first_text(
      number, list.empty() ? std::initializer_list<const char*>{"valueStandardMU", "standardUnc"}
                           : std::initializer_list<const char*>{"valueStandardMUXMLList", "standardUncXMLList"}));
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto places = places_to_mm(at(units, i).value_or(""));
    if (!places) continue;
    like.value_mm = shifted(values[i], *places);
    like.U_mm.reset();
    if (const auto U = at(expanded, i)) {
      like.U_mm = shifted(*U, *places);
      like.k = at(factors, i).value_or("2");
    } else if (const auto u = at(standard, i)) {
      like.U_mm = shifted(*u, *places);
      like.k = "1";
    }
    out.push_back(like);
  }
}

std::string name_of(const XmlNode& node) {
  std::string out;
  if (const auto name = node.child("name")) {
    for (const auto& content : name->children()) out += (out.empty() ? "" : " / ") + content.text();
  }
  return out;
}

/// A quantity's own name and refType, behind it the refTypes of the result and lists that it stands in; their name where
/// it has none.
void read_quantity(const XmlNode& quantity, const CertifiedLength& around, std::vector<CertifiedLength>& out) {
  CertifiedLength like = around;
  const std::string own_type = quantity.attribute("refType"), own_name = name_of(quantity);
  if (!own_type.empty()) like.ref_type = own_type + (around.ref_type.empty() ? "" : " " + around.ref_type);
  if (!own_name.empty()) like.name = own_name;
  std::vector<CertifiedLength> found;
  for (const auto& child : quantity.children()) {
    if (child.name() == "real") read_lengths(child, "", like, found);
    if (child.name() == "realListXMLList") read_lengths(child, "XMLList", like, found);
    if (child.name() != "hybrid") continue;
    for (const auto& one : child.children()) {
      if (found.empty()) read_lengths(one, one.name() == "real" ? "" : "XMLList", like, found);
    }
  }
  out.insert(out.end(), found.begin(), found.end());
}

void read_below(const XmlNode& node, const CertifiedLength& around, std::vector<CertifiedLength>& out) {
  for (const auto& child : node.children()) {
    if (child.name() == "quantity") {
      read_quantity(child, around, out);
    } else if (child.name() == "result" || child.name() == "list") {
      CertifiedLength inner = around;
      const std::string type = child.attribute("refType"), name = name_of(child);
      if (!type.empty()) inner.ref_type = type + (around.ref_type.empty() ? "" : " " + around.ref_type);
      if (!name.empty()) inner.name = name;
      read_below(child, inner, out);
    } else if (child.name() == "data") {
      read_below(child, around, out);
    }
  }
}

enum class Role { diameter, distance, form, other };

struct Words {
  Role role;
  std::vector<const char*> ref_types;  // parts of a refType, whatever its namespace
  std::vector<const char*> names;      // parts of a name
};

/// Form first: "form error of the diameter" is one. Names: English, German, French, Italian, Spanish, Portuguese, Dutch,
/// Polish, Czech, Swedish, Russian, Chinese, Japanese, Korean.
const std::vector<Words>& vocabulary() {
  static const std::vector<Words> kWords = {
      {Role::form,
       {"sphericity", "flatness", "roundness", "cylindricity", "formdeviation", "formerror"},
       {"sphericity",   "flatness",   "roundness", "cylindricity", "form",        "rundheit",      "ebenheit",
        "zylinderform", "sphéricité", "planéité",  "circularité",  "sfericità",   "planarità",     "rotondità",
        "esfericidad",  "planitud",   "redondez",  "esfericidade", "planeza",     "bolvormigheid", "vlakheid",
        "rondheid",     "płaskość",   "okrągłość", "rovinnost",    "kruhovitost", "planhet",       "rundhet",
        "плоскост",     "круглост",   "球度",      "平面度",       "圆度",        "真円度",        "真球度",
        "평면도",       "진원도"}},
      {Role::diameter,
       {"diameter"},
       {"diameter", "durchmesser", "diam", "diám", "diâm", "średnica", "Średnica", "průměr", "диаметр", "Диаметр",
        "直径", "直徑", "지름"}},
      {Role::distance,
       {"distance", "spacing", "centrelength", "centerlength", "centretocentre", "centertocenter"},
       {"distance", "abstand", "spacing", "distanz", "distancia", "distância", "entraxe", "interasse", "afstand",
        "odległość", "vzdálenost", "avstånd", "расстояни", "Расстояни", "距离", "距離", "中心距", "거리"}}};
  return kWords;
}

bool has_any(std::string words, const std::vector<const char*>& parts) {
  std::transform(words.begin(), words.end(), words.begin(), [](unsigned char c) { return std::tolower(c); });
  return std::any_of(parts.begin(), parts.end(),
                     [&](const char* part) { return words.find(part) != std::string::npos; });
}

/// What the certificate says for machines decides; only where that says nothing, what it says for people.
Role role_of(const CertifiedLength& length) {
  for (const auto& words : vocabulary()) {
    if (has_any(length.ref_type, words.ref_types)) return words.role;
  }
  for (const auto& words : vocabulary()) {
    if (has_any(length.name, words.names)) return words.role;
  }
  return Role::other;
}

/// Beside what was certified a good-practice table has set points, limits and errors.
bool is_certified(const CertifiedLength& length) {
  return !has_any(length.ref_type, {"basic_nominalvalue", "basic_measurementerror", "basic_referencevalue",
                                    "basic_acceptancelimit", "basic_tolerancelimit", "basic_validityrange"});
}

/// Expanded uncertainty for the entry's one k.
std::string with_factor(const CertifiedLength& length, const std::string& k) {
  if (!length.U_mm) return "0";
  if (!length.k || *length.k == k) return *length.U_mm;
  return fmt::format("{}", std::strtod(length.U_mm->c_str(), nullptr) * std::strtod(k.c_str(), nullptr) /
                               std::strtod(length.k->c_str(), nullptr));
}

std::string quoted(const std::string& words) {
  const std::string json = to_json(Value(words));  // a JSON string is a TOML basic string
  return json.substr(0, json.find_last_not_of('\n') + 1);
}

}  // namespace

std::string shifted(const std::string& decimal, int places) {
  double check = 0;
  const char* begin = decimal.c_str() + (decimal.starts_with('+') ? 1 : 0);
  const auto [end, error] = std::from_chars(begin, decimal.c_str() + decimal.size(), check);
  if (error != std::errc() || end != decimal.c_str() + decimal.size())
    throw InputError(fmt::format("\"{}\" is not a number", decimal.substr(0, 40)));
  std::string digits(begin);
  int exponent = places;
  if (const auto e = digits.find_first_of("eE"); e != std::string::npos) {
    exponent += std::atoi(digits.c_str() + e + 1);
    digits.erase(e);
  }
  if (std::abs(exponent) > 40)
    throw InputError(fmt::format("\"{}\" is out of range for a length", decimal.substr(0, 40)));
  const bool negative = digits.starts_with('-');
  if (negative) digits.erase(0, 1);
  auto point = digits.find('.');
  if (point == std::string::npos)
    point = digits.size();
  else
    digits.erase(point, 1);
  const int new_point = static_cast<int>(point) + exponent;
  if (new_point <= 0) digits.insert(0, std::string(static_cast<std::size_t>(1 - new_point), '0'));
  const auto at_place = static_cast<std::size_t>(std::max(new_point, 1));
  if (digits.size() < at_place) digits.append(at_place - digits.size(), '0');
  std::string out = digits.substr(0, at_place);
  out.erase(0, std::min(out.find_first_not_of('0'), out.size() - 1));
  if (digits.size() > at_place) out += "." + digits.substr(at_place);
  return (negative ? "-" : "") + out;
}

ArtefactCertificate artefact_certificate(const XmlDocument& document, const std::string& file) {
  const XmlNode root = XmlNode::root(document);
  if (root.name() != "digitalCalibrationCertificate")
    throw InputError(fmt::format("{}: not a digital calibration certificate", file));
  ArtefactCertificate out;
  const auto first = [](const XmlNode& node, const char* name) {
    const auto found = node.below(name);
    return found.empty() ? std::string() : found.front().text();
  };
  for (const auto& core : root.below("coreData")) {
    out.certificate = core.text_of("uniqueIdentifier");
    out.date = core.text_of("issueDate").empty() ? core.text_of("endPerformanceDate") : core.text_of("issueDate");
  }
  for (const auto& laboratory : root.below("calibrationLaboratory")) {
    out.laboratory = laboratory.text_of("calibrationLaboratoryCode");
    if (out.laboratory.empty()) out.laboratory = first(laboratory, "content");
  }
  for (const auto& item : root.below("item")) {
    if (out.item.empty()) out.item = first(item, "content");
    if (out.serial_number.empty()) out.serial_number = first(item, "value");
  }
  for (const auto& statement : root.below("statement")) {
    if (statement.attribute("refType").find("basic_recalibration") != std::string::npos)
      out.recalibration_date = statement.text_of("date");
  }
  for (const auto& results : root.below("results")) {
    read_below(results, {}, out.lengths);
  }
  if (out.lengths.empty()) throw InputError(fmt::format("{}: certifies no length", file));
  return out;
}

std::string artefact_toml(const ArtefactCertificate& c, const ArtefactEntry& entry, const std::string& file) {
  std::vector<const CertifiedLength*> diameters, distances, forms, others;
  for (const auto& length : c.lengths) {
    const Role role = length.U_mm && is_certified(length) ? role_of(length) : Role::other;
    (role == Role::form       ? forms
     : role == Role::diameter ? diameters
     : role == Role::distance ? distances
                              : others)
        .push_back(&length);
  }
  const std::size_t n_diameters = entry.kind == "flat" ? 0 : entry.kind == "ball_bar" ? 2 : 1;
  if (diameters.size() < n_diameters || (entry.kind == "ball_bar" && distances.empty())) {
    std::string found;
    for (const auto& length : c.lengths) found += fmt::format("; \"{}\" {} mm", length.name, length.value_mm);
    throw InputError(fmt::format("{}: a {} needs {} certified diameter{}{}; the certificate has{}", file, entry.kind,
                                 n_diameters, n_diameters == 1 ? "" : "s",
                                 entry.kind == "ball_bar" ? " and a distance" : "", found.substr(1)));
  }
  const std::string valid_until = entry.valid_until.empty() ? c.recalibration_date : entry.valid_until;
  if (valid_until.empty())
    throw InputError(fmt::format("{}: states no date of recalibration; give --valid-until 2028-03-01", file));
  const CertifiedLength* leading = !diameters.empty() ? diameters.front() : !forms.empty() ? forms.front() : nullptr;
  if (leading == nullptr) throw InputError(fmt::format("{}: a flat needs a certified form error", file));
  const std::string k = leading->k.value_or("2");
  std::string out = fmt::format("\n[[artefact]]                              # from {}\nname = {}\nkind = \"{}\"\n",
                                quoted(file), quoted(entry.name.empty() ? c.item : entry.name), entry.kind);
  if (n_diameters == 1) out += fmt::format("diameter_mm = {}\n", diameters[0]->value_mm);
  if (n_diameters == 2) out += fmt::format("diameter_mm = [{}, {}]\n", diameters[0]->value_mm, diameters[1]->value_mm);
  if (n_diameters > 0) {
    const auto larger = [&](const CertifiedLength* a, const CertifiedLength* b) {
      return std::strtod(with_factor(*a, k).c_str(), nullptr) < std::strtod(with_factor(*b, k).c_str(), nullptr);
    };
    const auto end = diameters.begin() + static_cast<std::ptrdiff_t>(n_diameters);
    out += fmt::format("U_diameter_mm = {}\n", with_factor(**std::max_element(diameters.begin(), end, larger), k));
  }
  if (entry.kind == "ball_bar") {
    out += fmt::format("distance_mm = {}\nU_distance_mm = {}\n", distances[0]->value_mm, with_factor(*distances[0], k));
  }
  out += forms.empty() ? "form_mm = 0\nU_form_mm = 0\n"
                       : fmt::format("form_mm = {}\nU_form_mm = {}\n", forms[0]->value_mm, with_factor(*forms[0], k));
  out += fmt::format("k = {}\nexpansion_per_K = {}\nu_expansion_per_K = {}\n", k, entry.expansion_per_K,
                     entry.u_expansion_per_K);
  out += fmt::format("certificate = {}\nlaboratory = {}\ndate = {}\nvalid_until = {}\n", quoted(c.certificate),
                     quoted(c.laboratory), quoted(c.date), quoted(valid_until));
  for (const auto* length : others) {
    out += fmt::format("# also certified: {} {} mm, U = {} mm\n", quoted(length->name), length->value_mm,
                       length->U_mm.value_or("not stated"));
  }
  return out;
}

}  // namespace fringecal::reports
