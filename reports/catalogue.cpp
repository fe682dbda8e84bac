#include "reports/catalogue.h"

#include "core/error.h"
#include "core/value.h"
#include "reports/texts.h"

#include <fmt/format.h>

namespace fringecal::reports {

Catalogue::Catalogue(std::string_view toml, const std::string& file) {
  const Value all = parse_toml(toml, file);
  for (const auto& [key, value] : *all.if_object()) {
    if (const auto* text = value.if_text()) texts_[key] = *text;
    const auto* section = value.if_object();
    if (section == nullptr) continue;
    for (const auto& [inner, text] : *section) {
      require(text.if_text() != nullptr, "a catalogue holds texts");
      (key == "names" ? names_[inner] : texts_[fmt::format("{}.{}", key, inner)]) = *text.if_text();
    }
  }
}

const Catalogue& Catalogue::in(const std::string& language) {
  static const std::map<std::string, Catalogue> all = [] {
    std::map<std::string, Catalogue> out;
    for (const auto& [name, toml] : kCatalogues) {
      out.emplace(std::string(name), Catalogue(toml, fmt::format("reports/texts/{}.toml", name)));
    }
    return out;
  }();
  const auto found = all.find(language);
  if (found == all.end()) {
    throw InputError(
        fmt::format("there are no texts in the language \"{}\"; known: {}", language, fmt::join(languages(), ", ")));
  }
  return found->second;
}

std::vector<std::string> Catalogue::languages() {
  std::vector<std::string> out;
  out.reserve(kCatalogues.size());
  for (const auto& [name, toml] : kCatalogues) out.emplace_back(name);
  return out;
}

const std::string& Catalogue::operator()(const std::string& key) const {
  const auto found = texts_.find(key);
  if (found == texts_.end()) throw std::logic_error("the catalogue of texts has no " + key);
  return found->second;
}

std::string Catalogue::operator()(const std::string& key,
                                  const std::vector<std::pair<std::string, std::string>>& filled_in) const {
  const std::string& pattern = (*this)(key);
  std::string out;
  for (std::size_t at = 0; at < pattern.size();) {
    const auto open = pattern.find('{', at);
    out += pattern.substr(at, open - at);
    if (open == std::string::npos) break;
    const auto close = pattern.find('}', open);
    const std::string name = pattern.substr(open + 1, close - open - 1);
    bool known = false;
    for (const auto& [brace, text] : filled_in) {
      if (brace != name) continue;
      out += text;
      known = true;
    }
    if (!known) throw std::logic_error(fmt::format("the text {} wants a {{{}}}", key, name));
    at = close + 1;
  }
  return out;
}

std::string Catalogue::name(const std::string& recorded) const {
  if (const auto exact = names_.find(recorded); exact != names_.end()) return exact->second;
  for (const auto& [beginning, text] : names_) {
    if (beginning.ends_with(' ') && recorded.starts_with(beginning)) return text + recorded.substr(beginning.size());
  }
  return recorded;
}

std::vector<std::string> Catalogue::keys() const {
  std::vector<std::string> out;
  for (const auto& [key, text] : texts_) out.push_back(key);
  for (const auto& [key, text] : names_) out.push_back("names." + key);
  return out;
}

}  // namespace fringecal::reports
