#include "reports/certificate_check.h"

#include "core/error.h"
#include "core/file.h"
#include "metrology/history.h"
#include "reports/archival_pdf.h"
#include "reports/certificate.h"
#include "reports/certificate_dcc.h"
#include "reports/dcc_result.h"
#include "reports/signature.h"
#include "reports/time_stamp.h"
#include "reports/xml_document.h"

#include <fmt/format.h>

#include <charconv>
#include <ctime>
#include <tuple>

namespace fringecal::reports {
namespace {

std::string who(const SignatureVerdict& verdict) { return verdict.subject.empty() ? "somebody" : verdict.subject; }

/// Looks at the signatures; the fault, or "".
std::string check_signatures(const CheckRequest& request, CheckVerdict& out) {
  const SignatureVerdict xml = verify_xml(request.xml, request.trusted);
  if (!xml.present && !request.any_signer) {
    return "not signed: nothing shows who issued it, or that nothing was changed";
  }
  if (!xml.fault.empty()) return xml.fault;
  if (xml.present && request.trusted.empty() && !request.any_signer) {
    return fmt::format("signed by {}, and no trusted certificate was given to judge that by (--trust)", who(xml));
  }
  if (!xml.present) {
    out.passed.push_back("not signed; not asked for");
  } else {
    out.passed.push_back(fmt::format("signature intact, by {}{}", who(xml),
                                     request.trusted.empty() ? ", who was not judged" : ", trusted"));
  }
  if (!request.pdf) return "";
  if (!request.pdf_signature)
    return xml.present && !request.any_signer ? "the PDF is not signed (certificate.pdf.p7s is missing)" : "";
  const SignatureVerdict pdf = verify_detached(*request.pdf, *request.pdf_signature, request.trusted);
  if (!pdf.fault.empty()) return pdf.fault;
  if (pdf.subject != xml.subject) return fmt::format("the PDF is signed by {}, the XML by {}", who(pdf), who(xml));
  out.passed.push_back("signature of the PDF intact, by the same");
  return "";
}

/// A stamp of the future is none; clocks differ by minutes.
std::string latest_time() {
  constexpr std::time_t kClocks = 300;
  const std::time_t latest = std::time(nullptr) + kClocks;
  std::tm t{};
  gmtime_r(&latest, &t);
  char text[sizeof "2026-11-22T07:00:00Z"];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &t);
  return text;
}

std::string check_stamp(const char* what, const std::string& content, const std::string& stamp,
                        const std::pair<const CheckRequest&, std::string>& request_and_issue, CheckVerdict& out) {
  const auto& [request, issue_day] = request_and_issue;
  const TimeStampVerdict verdict = verify_time_stamp(content, stamp, request.trusted_stampers);
  if (!verdict.fault.empty()) return fmt::format("{}: {}", what, verdict.fault);
  if (verdict.time.substr(0, 10) < issue_day) {
    return fmt::format("{}: time-stamped {}, before its day of issue {}", what, verdict.time, issue_day);
  }
  if (verdict.time > latest_time()) return fmt::format("{}: time-stamped {}, which is to come", what, verdict.time);
  out.passed.push_back(
      fmt::format("{} time-stamped {} by {}{}", what, verdict.time, verdict.authority,
                  request.trusted_stampers.empty() ? ", who was not judged (--trust-timestamp)" : ", trusted"));
  return "";
}

std::string check_stamps(const CheckRequest& request, const XmlDocument& document, CheckVerdict& out) {
  std::string issued;
  for (const auto& date : XmlNode::root(document).below("issueDate")) issued = date.text();
  std::string fault;
  if (request.pdf && request.pdf_stamp) {
    fault = check_stamp("PDF", *request.pdf, *request.pdf_stamp, {request, issued}, out);
  }
  if (fault.empty() && request.xml_stamp) {
    fault = check_stamp("XML", request.xml, *request.xml_stamp, {request, issued}, out);
  }
  return fault;
}

std::string check_twins(const CheckRequest& request, CheckVerdict& out) {
  const auto attached = attachment_of_pdf(*request.pdf, "certificate.xml", "certificate.pdf");
  if (!attached) return "the PDF has no certificate.xml attached";
  if (*attached != request.xml) return "the XML attached to the PDF is not this XML";
  out.passed.push_back("the XML attached to the PDF is this XML, byte for byte");
  const auto faults = differences(text_of_pdf(*request.pdf), request.xml, request.xml_name);
  if (!faults.empty()) return faults.front();
  out.passed.push_back(
      "every number of the PDF's text stands in the XML with the same unit, and every result in the PDF");
  return "";
}

std::string check_data(const CheckRequest& request, const std::string& named, CheckVerdict& out) {
  if (named.empty() || (!request.data && !request.is_folder)) return "";
  if (!request.data) return "data.zip is missing; the XML names it";
  const std::string found = sha256_hex(*request.data);
  if (found != named) return fmt::format("data.zip is not the one that was certified: its SHA-256 is {}", found);
  out.passed.push_back("data.zip is the one that the XML names");
  return "";
}

/// Where the certificate itself is an entry, its files are those of it.
std::string check_own_entry(const metrology::History& history, const CheckRequest& request, const std::string& number,
                            CheckVerdict& out) {
  for (const auto& entry : history.entries("certificate")) {
    const Value document = parse_json(entry.document, request.history->string());
    const auto text = [&](const char* key) {
      const Value* value = document.find(key);
      return value != nullptr && value->if_text() != nullptr ? *value->if_text() : std::string();
    };
    if (text("number") != number) continue;
    const auto differs = [&](const char* key, const std::optional<std::string>& bytes) {
      return bytes && !text(key).empty() && text(key) != sha256_hex(*bytes);
    };
    for (const auto& [name, key, bytes] : {std::tuple("XML", "certificate_xml_sha256", std::optional(request.xml)),
                                           std::tuple("PDF", "certificate_pdf_sha256", request.pdf),
                                           std::tuple("data.zip", "data_zip_sha256", request.data)}) {
      if (!differs(key, bytes)) continue;
      return fmt::format("{}: certificate {} is entry {}, and this {} is not the one entered there",
                         request.history->string(), number, entry.number, name);
    }
    out.passed.push_back(fmt::format("the certificate is entry {} of {}", entry.number, request.history->string()));
    return "";
  }
  return "";
}

std::string check_results(const std::vector<DccMeasurement>& measurements, CheckVerdict& out) {
  std::size_t compared = 0;
  for (const auto& m : measurements) {
    if (m.record.empty()) continue;
    Certificate one;
    one.records.emplace_back();
    one.records.front().verification =
        metrology::verification_from(parse_json(m.record, "the record in the XML"), "the record in the XML");
    const auto lines = result_lines(one);
    if (lines.size() != m.results.size()) {
      return fmt::format("{} results are certified, the record has {}", m.results.size(), lines.size());
    }
    for (std::size_t k = 0; k < lines.size(); ++k) {
      const auto& certified = m.results[k];
      const auto& line = lines[k];
      const auto differs = [&](const char* what, const std::string& a, const std::string& b) {
        return fmt::format("result {}: {} is certified as {}, the record gives {}", certified.name, what, a, b);
      };
      if (certified.value != line.value) return differs("the value", certified.value, line.value);
      if (certified.U != line.U) return differs("U", certified.U, line.U);
      if (certified.k != line.k) return differs("k", certified.k, line.k);
      if (certified.unit != dsi_unit(line.unit)) return differs("the unit", certified.unit, dsi_unit(line.unit));
      if (certified.lower != line.lower || certified.upper != line.upper)
        return differs("the limit", certified.upper.value_or("none"), line.upper.value_or("none"));
      ++compared;
    }
  }
  if (compared > 0)
    out.passed.push_back(fmt::format("{} results follow from the verification records inside", compared));
  return "";
}

std::string check_history(const CheckRequest& request, const XmlDocument& document,
                          const std::vector<DccMeasurement>& measurements, CheckVerdict& out) {
  const auto& file = *request.history;
  const metrology::History history(file, metrology::History::Access::read);
  for (const auto& m : measurements) {
    if (!m.entry) return "a record of this certificate names no entry of a history";
    if (const auto fault = history.check(m.entry_hash)) return fmt::format("{}: {}", file.string(), fault->sentence);
    const auto entries = history.entries(std::nullopt, *m.entry - 1);
    if (entries.empty() || entries.front().number != *m.entry)
      return fmt::format("{} has no entry {}", file.string(), *m.entry);
    if (entries.front().hash != m.entry_hash)
      return fmt::format("entry {} of {} is another one: its hash is not the certified one", *m.entry, file.string());
    if (entries.front().document != m.record)
      return fmt::format("entry {} of {} is not the record in the XML", *m.entry, file.string());
  }
  out.passed.push_back(fmt::format("the records are entries of {}, its chain unbroken", file.string()));
  for (const auto& number : XmlNode::root(document).below("uniqueIdentifier")) {
    return check_own_entry(history, request, number.text(), out);
  }
  return "";
}

}  // namespace

CheckVerdict check_certificate(const CheckRequest& request) {
  CheckVerdict out;
  const XmlDocument document = XmlDocument::parse(request.xml, request.xml_name);
  if (XmlNode::root(document).name() != "digitalCalibrationCertificate") {
    out.fault = "not a digital calibration certificate: its root is " + XmlNode::root(document).name();
    return out;
  }
  if (request.schema) {
    if (const auto fault = document.fault_after_schema(*request.schema)) {
      out.fault = "not valid after the schema: " + *fault;
      return out;
    }
    out.passed.push_back("valid after the schema");
  }
  out.fault = check_signatures(request, out);
  if (!out.fault.empty()) return out;
  if (!(out.fault = check_stamps(request, document, out)).empty()) return out;
  const auto measurements = dcc_measurements(document);
  if (request.pdf && !(out.fault = check_twins(request, out)).empty()) return out;
  if (!(out.fault = check_data(request, data_sha256_of(document), out)).empty()) return out;
  if (!(out.fault = check_results(measurements, out)).empty()) return out;
  if (request.history) out.fault = check_history(request, document, measurements, out);
  return out;
}

}  // namespace fringecal::reports
