// XML from outside, read without trust.
//
// Nothing is loaded: no network, no file, no DTD. A document with a DOCTYPE is refused before its entities are looked at
// (so no entity bomb, no external entity); so are documents above 64 MB or nested deeper than 256. Time and memory are
// linear in the size of the file.
// Errors: InputError with the file, the line and what is wrong.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

// libxml2's own types, declared here so that its headers stay in the source files.
struct _xmlDoc;   // NOLINT(bugprone-reserved-identifier)
struct _xmlNode;  // NOLINT(bugprone-reserved-identifier)

namespace fringecal::reports {

class XmlDocument {
 public:
  static XmlDocument parse(const std::string& bytes, const std::string& name_in_messages);
  ~XmlDocument();
  XmlDocument(XmlDocument&&) noexcept;

  _xmlDoc* raw() const { return document_; }

  /// Why the document is not valid after the schema (its first fault, with the line); nothing where it is.
  /// schema: dcc.xsd with what it imports beside it. Throws InputError where it is no schema.
  std::optional<std::string> fault_after_schema(const std::filesystem::path& schema) const;

 private:
  explicit XmlDocument(_xmlDoc* document) : document_(document) {}
  _xmlDoc* document_ = nullptr;
};

/// The bytes of a file of at most 64 MB. Throws InputError.
std::string read_xml_bytes(const std::filesystem::path& file);

/// A node of the tree, as far as certificates need it. Valid as long as its document.
class XmlNode {
 public:
  static XmlNode root(const XmlDocument& document);

  std::string name() const;  // local
  std::string attribute(const char* name) const;
  std::string text() const;               // of all text below, joined
  std::vector<XmlNode> children() const;  // elements
  /// The first child of that name, or nothing.
  std::optional<XmlNode> child(const std::string& name) const;
  /// All elements below of that name, in document order.
  std::vector<XmlNode> below(const std::string& name) const;
  /// Text of the first child of that name; "" where there is none.
  std::string text_of(const std::string& name) const;
  /// All pieces of text below, each with white space cut at its ends, but those inside elements of these names.
  std::vector<std::string> texts_below(const std::vector<std::string>& without) const;

 private:
  explicit XmlNode(_xmlNode* node) : node_(node) {}
  _xmlNode* node_;
};

}  // namespace fringecal::reports
