// A page of HTML as an archival PDF (PDF/A-3b, ISO 19005-3) with its machine-readable twin attached.
//
// WeasyPrint sets the pages (tagged, fonts embedded); this file adds, in process with libqpdf, what the standard asks and
// WeasyPrint 57 does not write: an sRGB output intent beside the tags, the attachment as an associated file (6.8:
// AFRelationship, F and UF, media type, date), metadata that say so (6.6), and a document id made from the content. The
// same input gives the same bytes, with the same WeasyPrint and the same fonts.
// Claimed is level B: the tags are WeasyPrint's and not checked against level A.
//
// WeasyPrint gets the HTML on its standard input and nothing else; there is no shell; it is stopped after 120 s.
// Errors: EnvironmentError: WeasyPrint or pdftotext missing (with the package), older than 57, failing or too slow;
// InputError: bytes that are no PDF.
#pragma once

#include <optional>
#include <string>

namespace fringecal::reports {

struct PdfFacts {
  std::string title, author;
  std::string created;  // RFC 3339 UTC
};

struct PdfAttachment {
  std::string name, mime_type, description, bytes;
};

std::string archival_pdf(const std::string& html, const PdfFacts& facts,
                         const std::optional<PdfAttachment>& attachment = std::nullopt);

/// The text of all pages in reading order, UTF-8, a form feed after each page.
std::string text_of_pdf(const std::string& pdf);
/// The bytes of the attachment of that name; nothing where there is none. name_in_messages: of the PDF.
std::optional<std::string> attachment_of_pdf(const std::string& pdf, const std::string& attachment,
                                             const std::string& name_in_messages);

}  // namespace fringecal::reports
