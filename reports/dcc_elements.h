// The few elements that a DCC is made of, as functions: text in, escaped XML out.
#pragma once

#include "reports/certificate.h"
#include "reports/html.h"

#include <initializer_list>
#include <string>
#include <vector>

namespace fringecal::reports::dcc {

/// <dcc:tag>...</dcc:tag> and a line's end.
Markup node(const std::string& tag, const Markup& content, const std::string& ref_type = "");
/// The same with a text; nothing where the text is empty.
Markup leaf(const std::string& tag, const std::string& words, const std::string& ref_type = "");
/// A dcc:textType or richContentType of texts from outside (no language stated) or from the catalogue (language stated).
Markup texts(const std::string& tag, const std::vector<std::string>& words, const std::string& language = "");
/// si:real; U, k and coverage (in percent) empty: no uncertainty.
struct Real {
  std::string value, unit;
  std::string U = "", k = "", coverage_percent = "";
};
Markup real(const Real& real);
/// dcc:quantity with its name, value and what belongs to it.
Markup quantity(const std::string& ref_type, const Markup& name, const Markup& value, const Markup& more = {});
/// A file inside the document.
struct Embedded {
  std::string tag, file_name, mime_type, bytes;
};
Markup embedded(const Embedded& file, const Markup& description = {}, const std::string& ref_type = "");
/// White space runs become one space, ends are cut: for the schema's notEmptyStringType.
std::string one_line(const std::string& words);

}  // namespace fringecal::reports::dcc
