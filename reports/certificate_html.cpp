#include "reports/certificate_html.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <set>

namespace fringecal::reports {
namespace {

constexpr const char* kPassSign =
    "<svg viewBox=\"0 0 16 16\" width=\"34\" height=\"34\"><circle cx=\"8\" cy=\"8\" r=\"7.4\" fill=\"#1d6b3c\"/>"
    "<path d=\"M4.4 8.3l2.5 2.5 4.8-5.2\" fill=\"none\" stroke=\"#fff\" stroke-width=\"1.9\"/></svg>";
constexpr const char* kFailSign =
    "<svg viewBox=\"0 0 16 16\" width=\"34\" height=\"34\"><rect x=\"1.3\" y=\"1.3\" width=\"13.4\" height=\"13.4\" "
    "fill=\"#fff\" stroke=\"#a11f2a\" stroke-width=\"1.7\"/><path d=\"M4.7 4.7l6.6 6.6M11.3 4.7l-6.6 6.6\" "
    "stroke=\"#a11f2a\" stroke-width=\"1.9\"/></svg>";
constexpr const char* kOpenSign =
    "<svg viewBox=\"0 0 16 16\" width=\"34\" height=\"34\"><circle cx=\"8\" cy=\"8\" r=\"7\" fill=\"#fff\" "
    "stroke=\"#55606c\" stroke-width=\"1.4\"/><path d=\"M4.8 8h6.4\" stroke=\"#55606c\" stroke-width=\"1.8\"/></svg>";

std::optional<metrology::Verdict> overall(const Certificate& c) {
  std::optional<metrology::Verdict> out;
  for (const auto& record : c.records) {
    const auto verdict = metrology::verdict_of(record.verification);
    if (record.as_found || !verdict) continue;
    out = out ? metrology::worst(*out, *verdict) : *verdict;
  }
  return out;
}

const char* sign_of(const std::optional<metrology::Verdict>& verdict) {
  if (!verdict) return kOpenSign;
  switch (*verdict) {
    case metrology::Verdict::pass:
    case metrology::Verdict::conditional_pass:
      return kPassSign;
    case metrology::Verdict::not_proved:
      return kOpenSign;
    case metrology::Verdict::conditional_fail:
    case metrology::Verdict::fail:
      return kFailSign;
  }
  return kOpenSign;
}

Markup lines_of(const std::vector<std::string>& lines) {
  Markup out;
  for (const auto& line : lines) {
    if (line.empty()) continue;
    if (!out.empty()) out += element("br", {}, {});
    out += text(line);
  }
  return out;
}

Markup address_block(const Address& a) {
  const auto joined = [](const std::string& x, const std::string& y) {
    return x.empty() || y.empty() ? x + y : x + " " + y;
  };
  return lines_of({a.name, joined(a.street, a.street_no), joined(a.country_code + " " + a.post_code, a.city), a.phone,
                   a.email, a.web});
}

/// Rows of a table of facts; a row with an empty value is left out.
class Facts {
 public:
  void add(const std::string& name, const std::string& value) { add(name, value.empty() ? Markup() : text(value)); }
  void add(const std::string& name, const Markup& value) {
    if (value.empty()) return;
    rows_ += element("tr", element("th", {{"scope", "row"}}, text(name)) + element("td", value));
  }
  Markup table() const { return element("table", {{"class", "facts"}}, element("tbody", rows_)); }

 private:
  Markup rows_;
};

/// The earliest beginning and the latest end of all records, as days.
std::pair<std::string, std::string> days_of(const Certificate& c) {
  std::string begun = c.records.front().verification.begun, ended = c.records.front().verification.ended;
  for (const auto& r : c.records) {
    begun = std::min(begun, r.verification.begun);
    ended = std::max(ended, r.verification.ended);
  }
  return {begun.substr(0, 10), ended.substr(0, 10)};
}

Markup head(const Certificate& c, const Catalogue& words) {
  const std::string title = words(c.is_report ? "title.report" : "title.certificate");
  const std::string number = words(c.is_report ? "title.report_number" : "title.number");
  Markup letterhead = element("div", {{"class", "laboratory"}}, text(c.laboratory.address.name));
  if (!c.laboratory.accreditation.empty()) {
    letterhead += element("div", {{"class", "accreditation"}},
                          text(words("parties.accreditation") + " " + c.laboratory.accreditation));
  }
  Markup out = element("div", {{"class", "letterhead"}}, letterhead);
  if (c.is_test()) out += element("p", {{"class", "test"}}, text(words("title.test")));
  out += element("h1", text(title));
  out += element("p", {{"class", "number"}},
                 text(number + " ") + element("b", {{"class", "running-number"}}, text(c.number)));
  if (c.customer.amendment) {
    const auto& a = *c.customer.amendment;
    out += element("p", {{"class", "amendment"}},
                   text(words(a.replaces ? "amendment.replaces" : "amendment.amends", {{"number", a.number}}) +
                        (a.reason.empty() ? "" : " " + words("amendment.reason", {{"reason", a.reason}}))));
  }
  return out;
}

/// Two blocks side by side.
Markup pair_of(const Markup& left, const Markup& right) {
  return element("table", {{"class", "pair"}},
                 element("tr", element("td", {{"class", "first"}}, left) + element("td", right)));
}

Markup block(const std::string& heading, const Markup& content) {
  return element("div", {{"class", "label"}}, text(heading)) + element("div", {{"class", "block"}}, content);
}

Markup first_page(const Certificate& c, const Catalogue& words) {
  Markup out;
  Facts left, right, order;
  if (!c.is_report) {
    out += pair_of(block(words("parties.laboratory"), address_block(c.laboratory.address)),
                   block(words("parties.customer"), address_block(c.customer.address)));
    order.add(words("parties.place"), words("parties.place_" + c.laboratory.place));
    order.add(words("parties.order"), c.customer.order);
  }
  const Item& item = c.customer.item;
  left.add(words("item.name"), item.name);
  left.add(words("item.manufacturer"), item.manufacturer);
  left.add(words("item.model"), item.model);
  left.add(words("item.serial"), item.serial_number);
  left.add(words("item.inventory"), item.inventory_number);
  left.add(words("item.identification"), c.records.front().verification.scanner);
  const auto [begun, ended] = days_of(c);
  right.add(words("dates.received"), item.received);
  right.add(words("dates.begun"), begun);
  right.add(words("dates.ended"), ended);
  right.add(words("dates.issued"), c.issued.substr(0, 10));
  Markup condition;
  if (!item.condition.empty()) {
    condition =
        element("p", {{"class", "free"}},
                element("span", {{"class", "label"}}, text(words("item.condition") + ": ")) + text(item.condition));
  }
  return out + element("section", element("h2", text(words("item.heading"))) +
                                      pair_of(left.table(), right.table() + order.table()) + condition);
}

Markup conformity(const Certificate& c, const Catalogue& words) {
  const auto verdict = overall(c);
  Markup box = element("div", {{"class", "sign"}}, Markup::trusted(sign_of(verdict))) +
               element("p", {{"class", "overall"}}, text(words(overall_key(c))));
  Markup rules;
  std::set<metrology::DecisionRule> stated_rules;
  for (const auto& record : c.records) {
    if (verdict && stated_rules.insert(record.verification.decision_rule).second) {
      rules += element("p", element("b", text(words("conformity.rule") + ": ")) +
                                text(words(std::string("conformity.") + name_of(record.verification.decision_rule))));
    }
  }
  return element(
      "section", {{"class", "conformity"}},
      element("h2", text(words("conformity.heading"))) + element("div", {{"class", "verdict"}}, box) + rules);
}

Markup authorisation(const Certificate& c, const Catalogue& words) {
  Markup cells;
  for (const auto& person : c.laboratory.persons) {
    const std::string how = !c.signer ? words("parties.signed_by_hand")
                            : person.main_signer
                                ? words("parties.signed_electronically", {{"subject", c.signer->subject}})
                                : "";
    cells += element("td", element("div", {{"class", c.signer ? "line electronic" : "line"}}, text(how)) +
                               element("b", text(person.name)) + element("br", {}, {}) + text(person.role));
  }
  return element("section", {{"class", "authorisation"}},
                 element("h2", text(words("parties.authorised"))) +
                     element("table", {{"class", "signatures"}}, element("tr", cells)));
}

}  // namespace

std::string shown(const std::string& number) {
  std::string out;
  for (const char c : number) out += c == '-' ? std::string("\u2212") : std::string(1, c);
  return out;
}

std::string shown(const std::string& number, const std::string& unit) { return shown(number) + "\u00a0" + unit; }

std::string overall_key(const Certificate& certificate) {
  const auto verdict = overall(certificate);
  if (!verdict) return "conformity.none";
  std::string name = name_of(*verdict);
  for (char& c : name) c = c == ' ' ? '_' : c;
  return "conformity.overall_" + name;
}

std::string temperature_text(const metrology::Environment& e, const Catalogue& words) {
  if (!(e.u_temperature_degC > 0)) return shown(exact(e.temperature_degC), "°C");
  const Stated t = stated(e.temperature_degC, 2 * e.u_temperature_degC);
  return fmt::format("({} ± {})\u00a0°C {}", shown(t.value), shown(t.U), words("conditions.k"));
}

std::string certificate_html(const Certificate& c) {
  const Catalogue& words = Catalogue::in(c.language);
  const std::string title = words(c.is_report ? "title.report" : "title.certificate") + " " + c.number;
  Markup body = element("header", head(c, words)) + first_page(c, words) + conformity(c, words);
  if (!c.is_report) body += authorisation(c, words);
  body += certificate_results(c, words) + certificate_annex(c, words);
  body +=
      element("p", {{"class", "end"}}, text(words(c.is_report ? "title.report_end" : "title.end") + " " + c.number));
  // Words in the margins are elements of the page, so that no text from outside stands in the style sheet.
  const Markup running =
      element("div", {{"class", "running-laboratory"}}, text(c.laboratory.address.name)) +
      element("div", {{"class", "running-title"}}, text(title)) +
      element("div", {{"class", "running-test"}}, c.is_test() ? text(words("title.test")) : Markup());
  const std::string page_number =
      fmt::format("@page{{@bottom-right{{content:\"{} \" counter(page) \" {} \" counter(pages)}}}}",
                  words("title.page"), words("title.of"));
  return "<!DOCTYPE html>\n<html lang=\"" + escape(c.language) +
         "\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" "
         "content=\"width=device-width,initial-scale=1\">\n" +
         element("title", text(title)).html() + "\n<style>" + kCertificateStyle + page_number +
         "</style>\n</head>\n<body>\n" + element("main", running + body).html() + "\n</body>\n</html>\n";
}

}  // namespace fringecal::reports
