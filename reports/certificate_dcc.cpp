#include "reports/certificate_dcc.h"

#include "core/provenance.h"
#include "reports/certificate_figures.h"
#include "reports/certificate_html.h"
#include "reports/dcc_elements.h"
#include "reports/limit_figure.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>

namespace fringecal::reports {
namespace {

using dcc::leaf;
using dcc::node;
using dcc::texts;

constexpr std::array kOwnRefTypes = {"fringecal_result",
                                     "fringecal_toleranceLimitLower",
                                     "fringecal_toleranceLimitUpper",
                                     "fringecal_guardBand",
                                     "fringecal_conformanceProbability",
                                     "fringecal_budget",
                                     "fringecal_record",
                                     "fringecal_data",
                                     "fringecal_history"};

/// The words of one language, with that language stated at each.
class Writer {
 public:
  explicit Writer(const Certificate& c) : c_(c), words_(Catalogue::in(c.language)) {}
  std::string document() const;

 private:
  Markup say(const std::string& tag, const std::string& key) const { return texts(tag, {words_(key)}, c_.language); }
  Markup software() const;
  Markup ref_types() const;
  Markup core() const;
  Markup items() const;
  Markup contact(const std::string& tag, const Address& a) const;
  Markup persons() const;
  Markup statements() const;
  Markup statement(const std::vector<std::string>& words, const std::string& ref_type, const Markup& before = {},
                   const Markup& after = {}) const;
  Markup methods(const metrology::Verification& v) const;
  Markup equipment(const metrology::Verification& v) const;
  Markup conditions(const Record& record) const;
  Markup result(const ResultLine& line) const;
  Markup meta(const ResultLine& line) const;
  Markup figures() const;
  Markup measurement(const Record& record, const std::vector<ResultLine>& lines, int number) const;

  const Certificate& c_;
  const Catalogue& words_;
};

Markup Writer::software() const {
  return node("software", texts("name", {"fringecal"}) + leaf("release", std::string("v") + kProgramVersion) +
                              leaf("type", "application"));
}

Markup Writer::ref_types() const {
  Markup out;
  for (const auto* name : kOwnRefTypes) {
    out +=
        node("refTypeDefinition",
             texts("name", {name}) + leaf("namespace", "fringecal") + leaf("link", "urn:fringecal:reftypes:1"), name);
  }
  return node("refTypeDefinitions", out);
}

Markup Writer::core() const {
  std::string begun = c_.records.front().verification.begun, ended = c_.records.front().verification.ended;
  for (const auto& r : c_.records) {
    begun = std::min(begun, r.verification.begun);
    ended = std::max(ended, r.verification.ended);
  }
  Markup out = leaf("countryCodeISO3166_1", c_.laboratory.address.country_code) +
               leaf("usedLangCodeISO639_1", c_.language) + leaf("mandatoryLangCodeISO639_1", c_.language) +
               leaf("uniqueIdentifier", c_.number);
  if (!c_.customer.order.empty()) {
    out +=
        node("identifications", node("identification", leaf("issuer", "customer") + leaf("value", c_.customer.order) +
                                                           say("name", "parties.order")));
  }
  out += leaf("receiptDate", c_.customer.item.received) + leaf("beginPerformanceDate", begun.substr(0, 10)) +
         leaf("endPerformanceDate", ended.substr(0, 10)) + leaf("performanceLocation", c_.laboratory.place) +
         leaf("issueDate", c_.issued.substr(0, 10));
  if (c_.customer.amendment) {
    out += node("reportAmendedSubstituted",
                leaf("typeOfChange", c_.customer.amendment->replaces ? "substituted" : "amended") +
                    leaf("replacedUniqueIdentifier", c_.customer.amendment->number));
  }
  return node("coreData", out);
}

Markup Writer::items() const {
  const Item& item = c_.customer.item;
  const auto identification = [&](const char* issuer, const std::string& value, const char* key) {
    return value.empty() ? Markup()
                         : node("identification", leaf("issuer", issuer) + leaf("value", value) + say("name", key));
  };
  Markup out = texts("name", {item.name}) + texts("description", {item.condition});
  if (!item.manufacturer.empty()) out += node("manufacturer", texts("name", {item.manufacturer}));
  out += leaf("model", item.model);
  out += node("identifications", identification("manufacturer", item.serial_number, "item.serial") +
                                     identification("customer", item.inventory_number, "item.inventory") +
                                     identification("calibrationLaboratory", c_.records.front().verification.scanner,
                                                    "item.identification"));
  return node("items", node("item", out));
}

Markup Writer::contact(const std::string& tag, const Address& a) const {
  const Markup location = leaf("city", a.city) + leaf("countryCode", a.country_code) + leaf("postCode", a.post_code) +
                          leaf("street", a.street) + leaf("streetNo", a.street_no) + texts("further", {a.web});
  return node(tag,
              texts("name", {a.name}) + leaf("eMail", a.email) + leaf("phone", a.phone) + node("location", location));
}

Markup Writer::persons() const {
  Markup out;
  for (const auto& person : c_.laboratory.persons) {
    const bool signs = c_.signer && person.main_signer;
    out += node(
        "respPerson",
        node("person", texts("name", {person.name})) +
            (signs ? texts("description", {words_("parties.signed_electronically", {{"subject", c_.signer->subject}})},
                           c_.language)
                   : Markup()) +
            leaf("role", person.role) + leaf("mainSigner", person.main_signer ? "true" : "false") +
            (signs ? leaf("cryptElectronicSignature", "true") : Markup()));
  }
  return node("respPersons", out);
}

Markup Writer::statement(const std::vector<std::string>& words, const std::string& ref_type, const Markup& before,
                         const Markup& after) const {
  return node("statement",
              before + texts("declaration", {fmt::format("{}", fmt::join(words, "\n"))}, c_.language) + after,
              ref_type);
}

std::string conformity_of(metrology::Verdict verdict) {
  switch (verdict) {
    case metrology::Verdict::pass:
      return "pass";
    case metrology::Verdict::conditional_pass:
      return "conditionalPass";
    case metrology::Verdict::not_proved:
      return "noPass";
    case metrology::Verdict::conditional_fail:
      return "conditionalFail";
    case metrology::Verdict::fail:
      return "fail";
  }
  throw std::logic_error("broken contract: a verdict is one of five");
}

Markup Writer::statements() const {
  Markup out = statement({words_("remarks.item_only"), words_("remarks.reproduction")}, "",
                         leaf("norm", "ISO/IEC 17025:2017") + leaf("reference", "7.8.2.1"));
  std::vector<std::string> conformity = {words_(overall_key(c_))};
  std::optional<metrology::Verdict> verdict;
  for (const auto& record : c_.records) {
    const auto one = metrology::verdict_of(record.verification);
    if (!one) continue;
    conformity.push_back(words_(std::string("conformity.") + name_of(record.verification.decision_rule)));
    if (!record.as_found) verdict = verdict ? metrology::worst(*verdict, *one) : *one;
  }
  conformity.erase(std::unique(conformity.begin(), conformity.end()), conformity.end());
  out +=
      statement(conformity, "basic_conformity", {}, verdict ? leaf("conformity", conformity_of(*verdict)) : Markup());
  out += statement({words_("traceability.statement")}, "basic_traceability", leaf("traceable", "true"));
  if (c_.is_test()) out += statement({words_("title.test")}, "");
  if (!c_.customer.recalibration_date.empty()) {
    out += statement({words_("remarks.recalibration", {{"date", c_.customer.recalibration_date}})},
                     "basic_recalibration", {}, leaf("date", c_.customer.recalibration_date));
  }
  if (c_.customer.amendment) {
    const auto& a = *c_.customer.amendment;
    out += statement({words_(a.replaces ? "amendment.replaces" : "amendment.amends", {{"number", a.number}}),
                      a.reason.empty() ? "" : words_("amendment.reason", {{"reason", a.reason}})},
                     "");
  }
  if (!c_.laboratory.procedure.empty()) out += statement({words_("method.procedure"), c_.laboratory.procedure}, "");
  if (!c_.customer.remarks.empty()) {
    out += node("statement", say("name", "remarks.heading") + texts("declaration", {c_.customer.remarks}));
  }
  if (!c_.data_sha256.empty()) out += statement({words_("remarks.data") + " " + c_.data_sha256}, "fringecal_data");
  out += statement({words_(c_.signer ? "remarks.machine" : "remarks.machine_unsigned")}, "");
  return node("statements", out);
}

Markup Writer::methods(const metrology::Verification& v) const {
  std::set<std::string> coverages;
  std::string statement;
  for (const auto& line : result_lines(c_)) {
    if (coverages.insert(line.coverage_percent).second) {
      statement += words_("uncertainty.statement", {{"coverage", line.coverage_percent}}) + "\n";
    }
  }
  Markup out = node("usedMethod",
                    say("name", "uncertainty.heading") + texts("description", {dcc::one_line(statement)}, c_.language) +
                        leaf("norm", "JCGM 100:2008"),
                    "basic_uncertainty");
  std::string description = words_("method.geometry");
  const auto append = [&](const char* key, const std::vector<std::string>& lines) {
    for (const auto& line : lines) description += "\n" + words_(key) + ": " + line;
  };
  append("method.source", {v.plan_source});
  append("method.unchecked", v.plan_unchecked);
  append("method.deviations", v.deviations.empty() ? std::vector{words_("method.none")} : v.deviations);
  out += node("usedMethod",
              texts("name", {v.plan}) + texts("description", {description}, c_.language) + leaf("norm", v.plan_source),
              "basic_methodMeasurement");
  return node("usedMethods", out);
}

Markup Writer::equipment(const metrology::Verification& v) const {
  Markup out;
  for (const auto& a : v.artefacts) {
    Markup values, marks;
    for (const auto& value : a.values) {
      const Stated s = stated(value.value_mm, value.U_mm);
      const std::string k = exact(value.k);
      // The certificate's own coverage probability is not on record; k = 2 is 95.45 % of a normal distribution.
      values +=
          dcc::node("measuringEquipmentQuantity",
                    texts("name", {words_.name(value.name)}, c_.language) + dcc::real({s.value, "mm", s.U, k, "95.45"}),
                    "basic_certifiedValue");
    }
    const auto mark = [&](const char* key, const std::string& value) {
      if (!dcc::one_line(value).empty()) {
        marks += node("identification", leaf("issuer", "other") + leaf("value", value) + say("name", key));
      }
    };
    mark("traceability.certificate", a.certificate);
    mark("traceability.laboratory", a.laboratory);
    mark("traceability.date", a.date);
    mark("traceability.valid_until", a.valid_until);
    if (a.expired_accepted) mark("traceability.valid_until", words_("traceability.expired"));
    out += node("measuringEquipment",
                texts("name", {a.name}) + texts("description", {words_.name(a.kind)}, c_.language) +
                    (marks.empty() ? Markup() : node("identifications", marks)) +
                    (values.empty() ? Markup() : node("measuringEquipmentQuantities", values)),
                "basic_normalUsed");
  }
  return out.empty() ? out : node("measuringEquipments", out);
}

Markup Writer::conditions(const Record& record) const {
  const auto& e = record.verification.environment;
  const bool adjusted = std::any_of(c_.records.begin(), c_.records.end(), [](const Record& r) { return r.as_found; });
  const std::string status = !adjusted ? "" : record.as_found ? "beforeAdjustment" : "afterAdjustment";
  dcc::Real temperature{exact(e.temperature_degC), "°C"};
  if (e.u_temperature_degC > 0) {
    const Stated t = stated(e.temperature_degC, 2 * e.u_temperature_degC);
    temperature = {t.value, "°C", t.U, "2", "95.45"};
  }
  const auto condition = [&](const char* key, const char* ref_type, const Markup& value) {
    return node("influenceCondition",
                say("name", key) + leaf("status", status) + node("data", dcc::quantity("", say("name", key), value)),
                ref_type);
  };
  Markup out = condition("conditions.temperature", "basic_temperature", dcc::real(temperature));
  if (e.humidity_percent) {
    out += condition("conditions.humidity", "basic_humidityRelative",
                     element("si:hybrid", dcc::real({fmt::format("{:.10g}", *e.humidity_percent / 100), "1"}) +
                                              dcc::real({exact(*e.humidity_percent), "%"})));
  }
  return node("influenceConditions", out);
}

Markup Writer::meta(const ResultLine& line) const {
  Markup out;
  const auto limit = [&](const char* ref_type, const std::optional<std::string>& value) {
    return value ? dcc::quantity(ref_type, say("name", "results.limit"), dcc::real({*value, line.unit})) : Markup();
  };
  const Markup limits =
      limit("fringecal_toleranceLimitLower", line.lower) + limit("fringecal_toleranceLimitUpper", line.upper);
  if (line.verdict) {
    std::string name = name_of(*line.verdict);
    std::replace(name.begin(), name.end(), ' ', '_');
    const auto& judgement = *line.quantity->judgement;
    const Markup data = limits +
                        dcc::quantity("fringecal_guardBand", texts("name", {"guard band"}),
                                      dcc::real({two_digits(judgement.guard_band), line.unit})) +
                        dcc::quantity("fringecal_conformanceProbability", texts("name", {"conformance probability"}),
                                      dcc::real({fmt::format("{:.4f}", judgement.conformance_probability), "1"}));
    out += node("metaData",
                texts("declaration", {words_("conformity." + name)}, c_.language) +
                    leaf("conformity", conformity_of(*line.verdict)) + node("data", data),
                "basic_conformity");
  }
  for (const auto& budget : lines_with_budget(result_lines(c_))) {
    if (budget.number != line.number) continue;
    Markup contributions;
    for (const auto& one : line.quantity->budget) {
      contributions += dcc::quantity("", texts("name", {words_.name(one.name)}, c_.language),
                                     dcc::real({two_digits(one.u_of_quantity()), line.unit}));
    }
    contributions += dcc::quantity("", say("name", "uncertainty.combined"),
                                   dcc::real({two_digits(line.quantity->uncertainty.u), line.unit}));
    out += node("metaData", say("name", "uncertainty.heading") + node("data", contributions), "fringecal_budget");
  }
  return out.empty() ? out : node("measurementMetaData", out);
}

Markup Writer::result(const ResultLine& line) const {
  // The words of the table's line, so that every number of the PDF's text is here too.
  const std::string name = fmt::format("{}: {}, {}", line.number, line.symbol, words_.name(line.name));
  const std::string where = fmt::format("{} {}", line.artefact, words_.name(line.position));
  return dcc::quantity("fringecal_result basic_measurementError",
                       texts("name", {name}, c_.language) + texts("description", {where}, c_.language),
                       dcc::real({line.value, line.unit, line.U, line.k, line.coverage_percent}), meta(line));
}

/// The figures of the certificate as a whole, each with its caption and the numbers that it shows.
Markup Writer::figures() const {
  Markup out;
  std::map<std::string, int> numbers;
  for (const auto& figure : certificate_figures(c_, words_)) {
    const std::string file = fmt::format("{}-{}.svg", figure.name, ++numbers[figure.name]);
    out += node("result",
                texts("name", {file}) +
                    node("data", dcc::embedded(
                                     {"byteData", file, "image/svg+xml", figure.picture.html()},
                                     texts("description", {dcc::one_line(figure.caption + " [" + figure.numbers + "]")},
                                           c_.language))));
  }
  return out;
}

Markup Writer::measurement(const Record& record, const std::vector<ResultLine>& all, int number) const {
  const auto& v = record.verification;
  Markup list;
  std::vector<ResultLine> lines;
  for (const auto& line : all) {
    if (line.quantity < v.quantities.data() || line.quantity >= v.quantities.data() + v.quantities.size()) continue;
    list += result(line);
    lines.push_back(line);
  }
  Markup results = node("result", say("name", "results.heading") + node("data", node("list", list)));
  int picture_number = 0;
  for (const auto& picture : limit_figures(lines)) {
    const std::string file = fmt::format("figure-{}-{}.svg", number, ++picture_number);
    results +=
        node("result", texts("name", {file}) +
                           node("data", dcc::embedded({"byteData", file, "image/svg+xml", picture.html()},
                                                      texts("description", {words_("results.figure")}, c_.language))));
  }
  if (&record == &c_.records.back()) results += figures();
  const bool adjusted = std::any_of(c_.records.begin(), c_.records.end(), [](const Record& r) { return r.as_found; });
  const std::string title = !adjusted ? "results.heading" : record.as_found ? "results.as_found" : "results.as_left";
  Markup origin = node(
      "metaData",
      texts("name", {words_("remarks.record", {{"line", std::to_string(number)}}) + " " + record.sha256}, c_.language) +
          node("data", dcc::embedded({"byteData", fmt::format("verification-{}.json", number), "application/json",
                                      record.document})),
      "fringecal_record");
  if (record.entry) {
    const std::string words =
        words_("remarks.history", {{"number", std::to_string(*record.entry)}}) + " " + record.entry_hash;
    origin += node("metaData", texts("declaration", {words}, c_.language), "fringecal_history");
  }
  return node(
      "measurementResult",
      say("name", title) + methods(v) +
          node("usedSoftware",
               node("software", texts("name", {v.provenance.program}) + leaf("release", "v" + v.provenance.version) +
                                    texts("description",
                                          {words_("method.software", {{"program", v.provenance.program},
                                                                      {"version", v.provenance.version}})},
                                          c_.language))) +
          equipment(v) + conditions(record) + node("results", results) + node("measurementMetaData", origin));
}

std::string Writer::document() const {
  const std::vector<ResultLine> lines = result_lines(c_);
  Markup administrative = node("dccSoftware", software()) + ref_types() + core() + items();
  administrative +=
      node("calibrationLaboratory", leaf("calibrationLaboratoryCode", c_.laboratory.accreditation) +
                                        contact("contact", c_.laboratory.address) +
                                        (c_.signer ? leaf("cryptElectronicSignature", "true") : Markup()));
  administrative += persons() + contact("customer", c_.customer.address) + statements();
  Markup measurements;
  int number = 0;
  for (const auto& record : c_.records) measurements += measurement(record, lines, ++number);
  const Markup root = element(
      "dcc:digitalCalibrationCertificate",
      {{"xmlns:dcc", "https://ptb.de/dcc"}, {"xmlns:si", "https://ptb.de/si"}, {"schemaVersion", "3.3.0"}},
      Markup::trusted("\n") + node("administrativeData", administrative) + node("measurementResults", measurements));
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" + root.html() + "\n";
}

}  // namespace

std::string certificate_dcc(const Certificate& certificate) { return Writer(certificate).document(); }

}  // namespace fringecal::reports
