// Judging a certificate: is it what its laboratory signed, and does it say the same everywhere?
//
// In this order; the first fault ends it:
//   schema      valid after the DCC schema, where one is given
//   signature   XMLDSig of the XML, and its chain to a trusted certificate; CMS of the PDF, where it lies beside it
//   time stamps of PDF and XML, where they lie beside them: imprint, authority, chain; not before the day of issue and not
//               in the future. Without a trusted authority it is said that who stamped was not judged
//   twins       the XML attached to the PDF is the XML, byte for byte
//   text        every number in the PDF's text stands in the XML, with the same unit where it has one, and every result
//               of the XML stands in the PDF's text
//   data        data.zip is the one that the XML names by its SHA-256
//   results     the results are those of the verification record inside the XML, rounded anew
//   history     the record is that entry of the history, unaltered, in an unbroken chain; where the certificate itself
//               is an entry, PDF and XML are those of it
// "Number": a word of the text with a digit in it ("0.0123", "K-2026-17", "17025:2017"); pages are numbered n of m and are
// checked for that only. Words broken at a line's end match a part of a word of the XML.
//
// A file that cannot be read or is hostile: InputError.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::reports {

struct CheckRequest {
  std::string xml, xml_name;  // content, and how to call it in messages
  std::optional<std::string> pdf, pdf_signature;
  std::optional<std::string> data;  // data.zip
  bool is_folder = false;           // a certificate's folder: what the XML names must be there
  std::optional<std::filesystem::path> schema, history;
  std::vector<std::filesystem::path> trusted, trusted_stampers;
  std::optional<std::string> pdf_stamp, xml_stamp;  // FILE.tsr
  bool any_signer = false;  // judge integrity only: an absent signature, or one by anybody, is no fault
};

struct CheckVerdict {
  std::vector<std::string> passed;  // what was looked at and holds, one sentence each
  std::string fault;                // empty: nothing wrong
};

CheckVerdict check_certificate(const CheckRequest& request);

/// Words with a digit in them, and for each the unit that follows it in the text or "": for the comparison of PDF and XML.
struct NumberWord {
  std::string word, unit;
};
std::vector<NumberWord> number_words(const std::string& text);

/// Numbers in the PDF's text that do not stand in the XML with the same unit, as sentences.
std::vector<std::string> differences(const std::string& pdf_text, const std::string& xml, const std::string& xml_name);

}  // namespace fringecal::reports
