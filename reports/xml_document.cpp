#include "reports/xml_document.h"

#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>
#include <libxml/parser.h>
#include <libxml/tree.h>
#include <libxml/xmlerror.h>
#include <libxml/xmlschemas.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

namespace fringecal::reports {
namespace {

constexpr std::uintmax_t kLargestFile = 64u << 20;

struct Free {
  void operator()(xmlParserCtxtPtr x) const { xmlFreeParserCtxt(x); }
  void operator()(xmlSchemaParserCtxtPtr x) const { xmlSchemaFreeParserCtxt(x); }
  void operator()(xmlSchemaPtr x) const { xmlSchemaFree(x); }
  void operator()(xmlSchemaValidCtxtPtr x) const { xmlSchemaFreeValidCtxt(x); }
};

void ignore(void*, xmlErrorPtr) {}

/// The first error of a validation, as one line.
struct First {
  std::string sentence;
  static void note(void* self, xmlErrorPtr error) {
    auto& me = *static_cast<First*>(self);
    if (!me.sentence.empty() || error == nullptr || error->message == nullptr) return;
    std::string words = error->message;
    words.erase(std::find(words.begin(), words.end(), '\n'), words.end());
    me.sentence = fmt::format("line {}: {}", error->line, words.substr(0, 300));
  }
};

void refuse_doctype(void* context, const xmlChar*, const xmlChar*, const xmlChar*) {
  auto* parser = static_cast<xmlParserCtxtPtr>(context);
  *static_cast<bool*>(parser->_private) = true;
  xmlStopParser(parser);
}

std::string from(const xmlChar* text) { return text == nullptr ? "" : reinterpret_cast<const char*>(text); }

}  // namespace

XmlDocument::~XmlDocument() {
  if (document_ != nullptr) xmlFreeDoc(document_);
}
XmlDocument::XmlDocument(XmlDocument&& other) noexcept : document_(std::exchange(other.document_, nullptr)) {}

XmlDocument XmlDocument::parse(const std::string& bytes, const std::string& name) {
  if (bytes.size() > kLargestFile) {
    throw InputError(fmt::format("{}: {} bytes of XML; at most {} are read", name, bytes.size(), kLargestFile));
  }
  const std::unique_ptr<xmlParserCtxt, Free> parser(xmlNewParserCtxt());
  require(parser != nullptr, "there is memory for a parser");
  bool has_doctype = false;
  parser->_private = &has_doctype;
  parser->sax->internalSubset = &refuse_doctype;
  xmlSetStructuredErrorFunc(nullptr, &ignore);
  xmlDocPtr document = xmlCtxtReadMemory(parser.get(), bytes.data(), static_cast<int>(bytes.size()), nullptr, nullptr,
                                         XML_PARSE_NONET | XML_PARSE_NOERROR | XML_PARSE_NOWARNING | XML_PARSE_NOCDATA);
  XmlDocument out(document);
  if (has_doctype) throw InputError(fmt::format("{}: has a DOCTYPE; a certificate has none, and none is read", name));
  if (document == nullptr || parser->wellFormed == 0) {
    std::string words = parser->lastError.message != nullptr ? parser->lastError.message : "empty";
    words.erase(std::find(words.begin(), words.end(), '\n'), words.end());
    throw InputError(fmt::format("{}: line {}: not XML that is read here: {}", name, parser->lastError.line, words));
  }
  return out;
}

std::optional<std::string> XmlDocument::fault_after_schema(const std::filesystem::path& schema) const {
  const auto loader = xmlGetExternalEntityLoader();
  xmlSetExternalEntityLoader(&xmlNoNetExternalEntityLoader);
  const std::unique_ptr<xmlSchemaParserCtxt, Free> parser(xmlSchemaNewParserCtxt(schema.c_str()));
  First broken;
  xmlSchemaSetParserStructuredErrors(parser.get(), &First::note, &broken);
  const std::unique_ptr<xmlSchema, Free> parsed(xmlSchemaParse(parser.get()));
  xmlSetExternalEntityLoader(loader);
  if (!parsed) {
    throw InputError(fmt::format("{}: cannot be used as a schema ({})", schema.string(),
                                 broken.sentence.empty() ? "not there" : broken.sentence));
  }
  const std::unique_ptr<xmlSchemaValidCtxt, Free> validator(xmlSchemaNewValidCtxt(parsed.get()));
  First first;
  xmlSchemaSetValidStructuredErrors(validator.get(), &First::note, &first);
  const int status = xmlSchemaValidateDoc(validator.get(), document_);
  if (status == 0) return std::nullopt;
  return first.sentence.empty() ? fmt::format("the validator stopped with {}", status) : first.sentence;
}

std::string read_xml_bytes(const std::filesystem::path& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);
  if (!error && size > kLargestFile) {
    throw InputError(fmt::format("{}: {} bytes of XML; at most {} are read", file.string(), size, kLargestFile));
  }
  return read_bytes(file);
}

XmlNode XmlNode::root(const XmlDocument& document) { return XmlNode(xmlDocGetRootElement(document.raw())); }

std::string XmlNode::name() const { return from(node_->name); }

std::string XmlNode::attribute(const char* name) const {
  xmlChar* value = xmlGetNoNsProp(node_, reinterpret_cast<const xmlChar*>(name));
  std::string out = from(value);
  xmlFree(value);
  return out;
}

std::string XmlNode::text() const {
  xmlChar* content = xmlNodeGetContent(node_);
  std::string out = from(content);
  xmlFree(content);
  return out;
}

std::vector<XmlNode> XmlNode::children() const {
  std::vector<XmlNode> out;
  for (xmlNodePtr n = node_->children; n != nullptr; n = n->next) {
    if (n->type == XML_ELEMENT_NODE) out.push_back(XmlNode(n));
  }
  return out;
}

std::optional<XmlNode> XmlNode::child(const std::string& name) const {
  for (const auto& one : children()) {
    if (one.name() == name) return one;
  }
  return std::nullopt;
}

std::vector<XmlNode> XmlNode::below(const std::string& name) const {
  std::vector<XmlNode> out;
  for (const auto& one : children()) {
    if (one.name() == name) out.push_back(one);
    const auto deeper = one.below(name);
    out.insert(out.end(), deeper.begin(), deeper.end());
  }
  return out;
}

std::string XmlNode::text_of(const std::string& name) const {
  const auto found = child(name);
  return found ? found->text() : "";
}

std::vector<std::string> XmlNode::texts_below(const std::vector<std::string>& without) const {
  std::vector<std::string> out;
  if (std::find(without.begin(), without.end(), name()) != without.end()) return out;
  const auto elements = children();
  if (elements.empty()) {
    std::string words = text();
    constexpr const char* kSpace = " \t\r\n";
    const auto first = words.find_first_not_of(kSpace);
    if (first != std::string::npos) out.push_back(words.substr(first, words.find_last_not_of(kSpace) - first + 1));
  }
  for (const auto& one : elements) {
    const auto deeper = one.texts_below(without);
    out.insert(out.end(), deeper.begin(), deeper.end());
  }
  return out;
}

}  // namespace fringecal::reports
