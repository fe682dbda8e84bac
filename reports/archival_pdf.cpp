#define POINTERHOLDER_TRANSITION 4  // qpdf: std::shared_ptr everywhere
#include "reports/archival_pdf.h"

#include "core/error.h"
#include "core/provenance.h"
#include "reports/html.h"
#include "reports/process.h"

#include <fmt/format.h>
#include <lcms2.h>
#include <qpdf/QPDF.hh>
#include <qpdf/QPDFEmbeddedFileDocumentHelper.hh>
#include <qpdf/QPDFObjectHandle.hh>
#include <qpdf/QPDFWriter.hh>

#include <chrono>
#include <cstdlib>
#include <ctime>

namespace fringecal::reports {
namespace {

constexpr std::chrono::seconds kLimit{120};
constexpr int kOldestWeasyPrint = 57;
constexpr const char* kAdvice = "it sets the pages of the PDF: install the Debian package weasyprint and run again";

/// "2026-11-21T23:55:16Z" -> seconds since 1970, as SOURCE_DATE_EPOCH.
std::string epoch_of(const std::string& rfc3339) {
  std::tm t{};
  require(::strptime(rfc3339.c_str(), "%Y-%m-%dT%H:%M:%SZ", &t) != nullptr, "a document's date is RFC 3339 UTC");
  return std::to_string(::timegm(&t));
}

/// "2026-11-21T23:55:16Z" -> "D:20261121235516Z" [ISO 32000-1, 7.9.4].
std::string pdf_date(const std::string& rfc3339) {
  std::string digits;
  for (const char c : rfc3339) {
    if (c >= '0' && c <= '9') digits += c;
  }
  return "D:" + digits + "Z";
}

void check_version() {
  const FilterOutput version = run_filter({"weasyprint", "--version"}, "", kLimit, kAdvice);
  const auto digit = version.output.find_first_of("0123456789");
  const int major = version.status == 0 && digit != std::string::npos ? std::atoi(version.output.c_str() + digit) : 0;
  if (major < kOldestWeasyPrint) {
    throw EnvironmentError(fmt::format("weasyprint says \"{}\"; version {} or newer sets tagged pages",
                                       version.output.substr(0, version.output.find('\n')), kOldestWeasyPrint));
  }
}

std::string set_pages(const std::string& html, const PdfFacts& facts) {
  check_version();
  // `env` because run_filter hands on no environment of ours.
  const FilterOutput out = run_filter({"env", "SOURCE_DATE_EPOCH=" + epoch_of(facts.created), "weasyprint", "--quiet",
                                       "--encoding", "utf-8", "--pdf-variant", "pdf/ua-1", "-", "-"},
                                      html, kLimit, kAdvice);
  if (out.status != 0 || out.output.rfind("%PDF-", 0) != 0) {
    throw EnvironmentError(fmt::format("weasyprint failed (status {}): {}", out.status,
                                       out.errors.substr(out.errors.size() > 400 ? out.errors.size() - 400 : 0)));
  }
  return out.output;
}

/// The sRGB profile of Little CMS, with a fixed date in its header (bytes 24 to 35) [ICC.1:2001-04, 6.1].
std::string srgb_profile() {
  cmsHPROFILE profile = cmsCreate_sRGBProfile();
  cmsSetProfileVersion(profile, 2.1);
  cmsUInt32Number size = 0;
  cmsSaveProfileToMem(profile, nullptr, &size);
  std::string bytes(size, '\0');
  const bool saved = cmsSaveProfileToMem(profile, bytes.data(), &size) != 0;
  cmsCloseProfile(profile);
  require(saved && bytes.size() > 128, "Little CMS makes an sRGB profile");
  bytes.replace(24, 12, std::string("\x07\xD0\x00\x01\x00\x01\x00\x00\x00\x00\x00\x00", 12));  // 2000-01-01
  return bytes;
}

/// [ISO 19005-3, 6.6.2 and 6.6.4]: the same words as in the document information.
std::string xmp(const PdfFacts& facts, const std::string& producer) {
  const auto about = [](const std::string& content) {
    return "<rdf:Description rdf:about=\"\">" + content + "</rdf:Description>\n";
  };
  return "<?xpacket begin=\"\xEF\xBB\xBF\" id=\"W5M0MpCehiHzreSzNTczkc9d\"?>\n"
         "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\">\n"
         "<rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\" "
         "xmlns:dc=\"http://purl.org/dc/elements/1.1/\" "
         "xmlns:xmp=\"http://ns.adobe.com/xap/1.0/\" xmlns:pdf=\"http://ns.adobe.com/pdf/1.3/\" "
         "xmlns:pdfaid=\"http://www.aiim.org/pdfa/ns/id/\">\n" +
         about("<pdfaid:part>3</pdfaid:part><pdfaid:conformance>B</pdfaid:conformance>") +
         about("<dc:title><rdf:Alt><rdf:li xml:lang=\"x-default\">" + escape(facts.title) +
               "</rdf:li></rdf:Alt></dc:title>") +
         about("<dc:creator><rdf:Seq><rdf:li>" + escape(facts.author) + "</rdf:li></rdf:Seq></dc:creator>") +
         about("<xmp:CreateDate>" + facts.created + "</xmp:CreateDate><xmp:ModifyDate>" + facts.created +
               "</xmp:ModifyDate><xmp:CreatorTool>fringecal " + kProgramVersion + "</xmp:CreatorTool>") +
         about("<pdf:Producer>" + escape(producer) + "</pdf:Producer>") +
         "</rdf:RDF>\n</x:xmpmeta>\n<?xpacket end=\"w\"?>";
}

QPDFObjectHandle unicode(const std::string& utf8) { return QPDFObjectHandle::newUnicodeString(utf8); }

void attach(QPDF& pdf, const PdfAttachment& file, const PdfFacts& facts) {
  auto stream = QPDFObjectHandle::newStream(&pdf, file.bytes);
  auto params = QPDFObjectHandle::newDictionary();
  params.replaceKey("/ModDate", QPDFObjectHandle::newString(pdf_date(facts.created)));
  params.replaceKey("/Size", QPDFObjectHandle::newInteger(static_cast<long long>(file.bytes.size())));
  stream.getDict().replaceKey("/Type", QPDFObjectHandle::newName("/EmbeddedFile"));
  stream.getDict().replaceKey("/Subtype", QPDFObjectHandle::newName("/" + file.mime_type));
  stream.getDict().replaceKey("/Params", params);
  auto embedded = QPDFObjectHandle::newDictionary();
  embedded.replaceKey("/F", stream);
  embedded.replaceKey("/UF", stream);
  auto specification = QPDFObjectHandle::newDictionary();
  specification.replaceKey("/Type", QPDFObjectHandle::newName("/Filespec"));
  specification.replaceKey("/F", QPDFObjectHandle::newString(file.name));
  specification.replaceKey("/UF", unicode(file.name));
  specification.replaceKey("/Desc", unicode(file.description));
  specification.replaceKey("/AFRelationship", QPDFObjectHandle::newName("/Alternative"));
  specification.replaceKey("/EF", embedded);
  auto reference = pdf.makeIndirectObject(specification);
  QPDFEmbeddedFileDocumentHelper(pdf).replaceEmbeddedFile(file.name, QPDFFileSpecObjectHelper(reference));
  auto associated = QPDFObjectHandle::newArray();
  associated.appendItem(reference);
  pdf.getRoot().replaceKey("/AF", associated);
}

void make_archival(QPDF& pdf, const PdfFacts& facts) {
  auto root = pdf.getRoot();
  auto profile = QPDFObjectHandle::newStream(&pdf, srgb_profile());
  profile.getDict().replaceKey("/N", QPDFObjectHandle::newInteger(3));
  auto intent = QPDFObjectHandle::newDictionary();
  intent.replaceKey("/Type", QPDFObjectHandle::newName("/OutputIntent"));
  intent.replaceKey("/S", QPDFObjectHandle::newName("/GTS_PDFA1"));
  intent.replaceKey("/OutputConditionIdentifier", QPDFObjectHandle::newString("sRGB IEC61966-2.1"));
  intent.replaceKey("/Info", QPDFObjectHandle::newString("sRGB IEC61966-2.1"));
  intent.replaceKey("/DestOutputProfile", profile);
  auto intents = QPDFObjectHandle::newArray();
  intents.appendItem(pdf.makeIndirectObject(intent));
  root.replaceKey("/OutputIntents", intents);

  auto old_information = pdf.getTrailer().getKey("/Info");
  const std::string producer = old_information.isDictionary() && old_information.getKey("/Producer").isString()
                                   ? old_information.getKey("/Producer").getUTF8Value()
                                   : "WeasyPrint";
  auto information = QPDFObjectHandle::newDictionary();
  information.replaceKey("/Title", unicode(facts.title));
  information.replaceKey("/Author", unicode(facts.author));
  information.replaceKey("/Creator", unicode(std::string("fringecal ") + kProgramVersion));
  information.replaceKey("/Producer", unicode(producer));
  information.replaceKey("/CreationDate", QPDFObjectHandle::newString(pdf_date(facts.created)));
  information.replaceKey("/ModDate", QPDFObjectHandle::newString(pdf_date(facts.created)));
  pdf.getTrailer().replaceKey("/Info", pdf.makeIndirectObject(information));

  auto metadata = QPDFObjectHandle::newStream(&pdf, xmp(facts, producer));
  metadata.getDict().replaceKey("/Type", QPDFObjectHandle::newName("/Metadata"));
  metadata.getDict().replaceKey("/Subtype", QPDFObjectHandle::newName("/XML"));
  root.replaceKey("/Metadata", metadata);
}

std::string written(QPDF& pdf) {
  QPDFWriter writer(pdf);
  writer.setOutputMemory();
  writer.setMinimumPDFVersion("1.7");
  writer.setObjectStreamMode(qpdf_o_disable);
  writer.setDeterministicID(true);
  writer.write();
  const auto buffer = writer.getBufferSharedPointer();
  return {reinterpret_cast<const char*>(buffer->getBuffer()), buffer->getSize()};
}

}  // namespace

std::string archival_pdf(const std::string& html, const PdfFacts& facts,
                         const std::optional<PdfAttachment>& attachment) {
  const std::string pages = set_pages(html, facts);
  try {
    QPDF pdf;
    pdf.processMemoryFile("the pages of WeasyPrint", pages.data(), pages.size());
    make_archival(pdf, facts);
    if (attachment) attach(pdf, *attachment, facts);
    return written(pdf);
  } catch (const QPDFExc& e) {
    throw EnvironmentError(fmt::format("weasyprint's pages cannot be read ({})", e.what()));
  }
}

std::string text_of_pdf(const std::string& pdf) {
  // -raw: else a hyphen at a line's end would be taken out of an identifier.
  const FilterOutput out =
      run_filter({"pdftotext", "-raw", "-enc", "UTF-8", "-", "-"}, pdf, kLimit,
                 "it reads the text of a PDF: install the Debian package poppler-utils and run again");
  if (out.status != 0) {
    throw InputError(fmt::format("the PDF's text cannot be read: {}", out.errors.substr(0, out.errors.find('\n'))));
  }
  return out.output;
}

std::optional<std::string> attachment_of_pdf(const std::string& bytes, const std::string& attachment,
                                             const std::string& name) {
  try {
    QPDF pdf;
    pdf.setSuppressWarnings(true);
    pdf.processMemoryFile(name.c_str(), bytes.data(), bytes.size());
    const auto file = QPDFEmbeddedFileDocumentHelper(pdf).getEmbeddedFile(attachment);
    if (!file) return std::nullopt;
    auto stream = file->getEmbeddedFileStream();
    if (!stream.isStream()) return std::nullopt;
    const auto buffer = stream.getStreamData(qpdf_dl_all);
    return std::string(reinterpret_cast<const char*>(buffer->getBuffer()), buffer->getSize());
  } catch (const std::exception& e) {
    throw InputError(fmt::format("{}: cannot be read as a PDF ({})", name, e.what()));
  }
}

}  // namespace fringecal::reports
