// The words of certificates and reports in one language, from reports/texts/LANGUAGE.toml (built into the program).
//
//   const Catalogue& words = Catalogue::in("de");
//   words("results.heading")                              "Ergebnisse"
//   words("amendment.amends", {{"number", "K-17"}})       "Dieser Kalibrierschein ergänzt den Kalibrierschein Nr. K-17."
// Errors: a language without a file: InputError with those there are; a key or a {brace} without a text: std::logic_error.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace fringecal::reports {

class Catalogue {
 public:
  static const Catalogue& in(const std::string& language);
  static std::vector<std::string> languages();

  const std::string& operator()(const std::string& key) const;
  std::string operator()(const std::string& key,
                         const std::vector<std::pair<std::string, std::string>>& filled_in) const;
  /// A name out of a verification record in this language; itself where the catalogue does not know it.
  std::string name(const std::string& recorded) const;

  const std::string& language() const { return (*this)("language"); }
  std::vector<std::string> keys() const;

 private:
  explicit Catalogue(std::string_view toml, const std::string& file);
  std::map<std::string, std::string> texts_, names_;
};

}  // namespace fringecal::reports
