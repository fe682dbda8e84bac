// The comparison of the PDF's text with the XML.
#include "reports/catalogue.h"
#include "reports/certificate_check.h"
#include "reports/certificate_dcc.h"
#include "reports/dcc_result.h"
#include "reports/xml_document.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>

namespace fringecal::reports {
namespace {

using Pairs = std::set<std::pair<std::string, std::string>>;
constexpr std::size_t kSurelyBroken = 24;  // bytes; a longer word may be broken at a line's end anywhere

void replace_all(std::string& s, std::string_view what, std::string_view with) {
  for (auto at = s.find(what); at != std::string::npos; at = s.find(what, at + with.size()))
    s.replace(at, what.size(), with);
}

bool has_digit(const std::string& word) { return word.find_first_of("0123456789") != std::string::npos; }

/// Signs around a word go.
std::string stripped(std::string word) {
  constexpr const char *kBefore = "([{\"'", *kAfter = ")]}\"',;:.!?";
  const auto from = word.find_first_not_of(kBefore);
  if (from == std::string::npos) return "";
  word.erase(0, from);
  const auto to = word.find_last_not_of(kAfter);
  return to == std::string::npos ? "" : word.substr(0, to + 1);
}

/// The words of a text with the typography taken out: minus, no-break spaces, plus-minus, dashes, quotation marks.
std::vector<std::string> words_of(std::string text) {
  replace_all(text, "\u2212", "-");
  for (const char* sign : {"\u00a0", "\u202f", "±", "–", "—", "„", "“", "”", "‘", "’", "•", "·", "\f"})
    replace_all(text, sign, " ");
  replace_all(text, "%", " % ");
  std::vector<std::string> out;
  std::istringstream in(text);
  for (std::string word; in >> word;) {
    if (word = stripped(word); !word.empty()) out.push_back(word);
  }
  return out;
}

bool is_unit(const std::string& word) {
  static constexpr std::array kUnits = {"mm", "µm", "um", "m", "°C", "%", "mrad", "rad"};
  return std::find(kUnits.begin(), kUnits.end(), word) != kUnits.end();
}

/// Text beyond ASCII: Chinese may be broken between any two characters.
bool is_wide(std::string_view word) {
  return std::any_of(word.begin(), word.end(), [](char c) { return static_cast<unsigned char>(c) >= 0x80; });
}

/// What the XML says: its number words, and numbers with units, from quantities and from running text.
struct Said {
  std::set<std::string> words;
  std::vector<std::string> long_words;
  Pairs pairs;
  void take(const std::string& text) {
    for (const auto& one : number_words(text)) {
      words.insert(one.word);
      if (!one.unit.empty()) pairs.insert({one.word, one.unit});
    }
    for (const auto& word : words_of(text)) {
      if (word.size() > kSurelyBroken || word.find('-') != std::string::npos || is_wide(word)) {
        long_words.push_back(word);
      }
    }
  }
};

Said said_in(const XmlNode& root) {
  Said out;
  for (const auto& text : root.texts_below({"dataBase64", "Signature"})) out.take(text);
  for (const auto& real : root.below("real")) {
    const std::string unit = unit_of_dsi(real.text_of("unit"));
    out.pairs.insert({real.text_of("value"), unit});
    for (const auto& expanded : real.below("valueExpandedMU")) out.pairs.insert({expanded.text(), unit});
  }
  return out;
}

/// A piece of a word that was broken at a line's end: anywhere in a long or a Chinese one, after a hyphen in any.
bool is_piece(const std::string& piece, const Said& said) {
  const bool pure = piece.find_first_not_of("0123456789.,") == std::string::npos;
  return std::any_of(said.long_words.begin(), said.long_words.end(), [&](const std::string& word) {
    const auto at = word.find(piece);
    if (at == std::string::npos) return false;
    if (word.size() > kSurelyBroken && !pure) return true;
    if (!pure && (at == 0 || word[at - 1] == '-')) return true;
    const std::string around = word.substr(at > 0 ? at - 1 : 0, piece.size() + 2);
    return is_wide(around) || (word.size() > 4 * kSurelyBroken);
  });
}

/// Takes "Page 2 of 6" out of each page; a sentence where a page is not numbered so.
std::string take_page_numbers(std::vector<std::string>& pages, const Catalogue& words) {
  for (std::size_t k = 0; k < pages.size(); ++k) {
    const std::string number = fmt::format("{} {} {} {}", words("title.page"), k + 1, words("title.of"), pages.size());
    const auto at = pages[k].rfind(number);
    if (at == std::string::npos) return fmt::format("page {} of the PDF is not numbered \"{}\"", k + 1, number);
    pages[k].erase(at, number.size());
  }
  return "";
}

}  // namespace

std::vector<NumberWord> number_words(const std::string& text) {
  const auto words = words_of(text);
  std::vector<NumberWord> out;
  for (std::size_t k = 0; k < words.size(); ++k) {
    if (!has_digit(words[k])) continue;
    out.push_back({words[k], k + 1 < words.size() && is_unit(words[k + 1]) ? words[k + 1] : ""});
  }
  return out;
}

std::vector<std::string> differences(const std::string& pdf_text, const std::string& xml, const std::string& xml_name) {
  const XmlDocument document = XmlDocument::parse(xml, xml_name);
  const XmlNode root = XmlNode::root(document);
  std::string language = "en";
  for (const auto& one : root.below("usedLangCodeISO639_1")) language = one.text();
  std::vector<std::string> pages, out;
  std::istringstream in(pdf_text);
  for (std::string page; std::getline(in, page, '\f');) pages.push_back(page);
  if (!pages.empty() && words_of(pages.back()).empty()) pages.pop_back();
  if (auto fault = take_page_numbers(pages, Catalogue::in(language)); !fault.empty()) out.push_back(fault);

  const Said said = said_in(root);
  Pairs shown;
  for (std::size_t k = 0; k < pages.size(); ++k) {
    for (const auto& [word, unit] : number_words(pages[k])) {
      shown.insert({word, unit});
      if (!said.words.contains(word) && !is_piece(word, said)) {
        out.push_back(fmt::format("page {} of the PDF says \"{}\"; the XML does not", k + 1, word));
      } else if (!unit.empty() && !said.pairs.contains({word, unit}) && !is_piece(word, said)) {
        out.push_back(fmt::format("page {} of the PDF says \"{} {}\"; the XML has {} only with another unit", k + 1,
                                  word, unit, word));
      }
    }
  }
  for (const auto& measurement : dcc_measurements(document)) {
    for (const auto& result : measurement.results) {
      for (const auto& number : {result.value, result.U}) {
        if (shown.contains({number, unit_of_dsi(result.unit)})) continue;
        out.push_back(fmt::format("the XML says \"{} {}\" in {}; the PDF does not", number, unit_of_dsi(result.unit),
                                  result.name));
      }
    }
  }
  return out;
}

}  // namespace fringecal::reports
