// A certificate as its laboratory makes it and its customer checks it, with independent programs as witnesses: xmlsec1,
// poppler, and a network namespace without interfaces.
#include "core/file.h"
#include "core/value.h"
#include "metrology/history.h"
#include "reports/archival_pdf.h"
#include "reports/certificate_check.h"
#include "reports/signature.h"
#include "tests/support/program.h"
#include "tests/support/sample_verification.h"
#include "tests/support/stamping_authority.h"
#include "tests/support/test_key.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <memory>
#include <regex>
#include <string>
#include <vector>

namespace fringecal {
namespace {

namespace fs = std::filesystem;
using test::run_fringecal;
using testing::HasSubstr;
using testing::Not;

const fs::path kSchemas = fs::path(FRINGECAL_SHARED_DATA) / "dcc-schema";

class Certify : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    ::setenv("SOURCE_DATE_EPOCH", "1795330800", 1);  // 2026-11-22T07:00:00Z
    folder_ = std::make_unique<test::ScratchFolder>();
    auto record = test::sample_verification();
    test::add_features(record, folder_->path());
    write_atomically(*folder_ / "verification.json", to_json(metrology::to_value(record)));
    write_atomically(*folder_ / "lab.toml", test::sample_laboratory());
    write_atomically(*folder_ / "customer.toml", test::sample_customer());
    test::make_test_key(folder_->path(), "lab", "ec");
    const auto made = run_fringecal(certify({path("verification.json")}, "certificate"));
    ASSERT_EQ(made.exit_code, 0) << made.errors;
    EXPECT_THAT(made.output, HasSubstr("13 results, signed by"));
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static std::string path(const std::string& name) { return (*folder_ / name).string(); }
  static std::vector<std::string> certify(const std::vector<std::string>& records, const std::string& output,
                                          const std::vector<std::string>& more = {}) {
    std::vector<std::string> out = {"certify"};
    out.insert(out.end(), records.begin(), records.end());
    for (const auto& one :
         {"--lab", "lab.toml", "--customer", "customer.toml", "--key", "lab.key", "--certificate", "lab.pem"}) {
      out.push_back(std::string(one).starts_with("--") ? one : path(one));
    }
    out.insert(out.end(), {"--number", "K-2026-0017", "-o", path(output)});
    if (fs::exists(kSchemas)) out.insert(out.end(), {"--schema-dir", kSchemas.string()});
    out.insert(out.end(), more.begin(), more.end());
    return out;
  }
  static std::string bytes(const std::string& name) { return read_bytes(*folder_ / name); }

  static std::unique_ptr<test::ScratchFolder> folder_;
};
std::unique_ptr<test::ScratchFolder> Certify::folder_;

TEST_F(Certify, MakesACertificateThatItsCustomerCanCheck) {
  std::vector<std::string> arguments = {"check", path("certificate"), "--trust", path("lab.pem")};
  if (fs::exists(kSchemas)) arguments.insert(arguments.end(), {"--schema-dir", kSchemas.string()});
  const auto checked = run_fringecal(arguments);
  EXPECT_EQ(checked.exit_code, 0) << checked.errors;
  EXPECT_THAT(checked.output, HasSubstr("nothing wrong"));
  const auto nobody = run_fringecal({"check", path("certificate")});
  EXPECT_EQ(nobody.exit_code, 2);
  EXPECT_THAT(nobody.errors, HasSubstr("--trust"));
}

TEST_F(Certify, SignsSoThatEveryOneOf200AlterationsIsRefused) {
  const std::string xml = bytes("certificate/certificate.xml"), altered_file = path("altered.xml");
  const auto accepted = [&](const std::string& file) {
    return test::run({"xmlsec1", "--verify", "--trusted-pem", path("lab.pem"), file}).status == 0;
  };
  ASSERT_TRUE(accepted(path("certificate/certificate.xml")));
  // What is signed: the canonical form of the document without its signature element, and in that SignedInfo, which
  // holds the document's digest [XML Signature, 6.6.4]. Not the spaces between the other parts of the signature.
  const auto canonical = [](const std::string& file) {
    std::string text = test::run({"xmllint", "--nonet", "--c14n11", file}).output;
    const auto begin = text.find("<Signature "), end = text.find("</Signature>");
    const auto info = text.find("<SignedInfo"), info_end = text.find("</SignedInfo>");
    if (begin == std::string::npos || info == std::string::npos || info_end > end) return text;
    return text.substr(0, begin) + text.substr(info, info_end - info) + text.substr(end);
  };
  const std::string original = canonical(path("certificate/certificate.xml"));
  int outside = 0;
  for (int k = 0; k < 200; ++k) {
    const std::size_t at = static_cast<std::size_t>(k) * (xml.size() - 1) / 199;
    std::string altered = xml;
    altered[at] = altered[at] == '5' ? '6' : '5';
    write_atomically(altered_file, altered);
    const bool by_xmlsec1 = accepted(altered_file);
    bool by_us = true;
    try {
      const auto verdict = reports::verify_xml(altered, {path("lab.pem")});
      by_us = verdict.present && verdict.fault.empty();
    } catch (const std::exception&) {
      by_us = false;
    }
    EXPECT_FALSE(by_us && !by_xmlsec1) << "byte " << at;
    if (!by_xmlsec1) continue;
    // An alteration that leaves what is signed as it is, is outside.
    EXPECT_EQ(canonical(altered_file), original) << "byte " << at << " of " << xml.size();
    ++outside;
  }
  // Some 300 bytes lie between two alterations: one in the XML declaration, one in the last line's end, and one among the
  // line ends inside the signature element are all that can be.
  EXPECT_LE(outside, 3);
}

TEST_F(Certify, MakesAnArchivalPdfWithItsTwinInside) {
  const std::string pdf = path("certificate/certificate.pdf");
  const auto info = test::run({"pdfinfo", pdf});
  EXPECT_THAT(info.output, HasSubstr("Tagged:          yes"));
  EXPECT_THAT(info.output, HasSubstr("PDF version:     1.7"));
  const std::string metadata = test::run({"pdfinfo", "-meta", pdf}).output;
  EXPECT_THAT(metadata, HasSubstr("<pdfaid:part>3</pdfaid:part><pdfaid:conformance>B</pdfaid:conformance>"));
  const std::string fonts = test::run({"pdffonts", pdf}).output;
  const std::regex embedded(R"(yes yes yes +\d+ +0)");
  int n_fonts = 0;
  std::istringstream lines(fonts.substr(fonts.find("----\n") + 1));
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || line.find("---") != std::string::npos) continue;
    EXPECT_TRUE(std::regex_search(line, embedded)) << line;
    ++n_fonts;
  }
  EXPECT_GE(n_fonts, 2);
  ASSERT_EQ(test::run({"pdfdetach", "-save", "1", "-o", path("detached.xml"), pdf}).status, 0);
  EXPECT_EQ(bytes("detached.xml"), bytes("certificate/certificate.xml"));
  EXPECT_EQ(test::run({"qpdf", "--check", pdf}).status, 0);
  std::istringstream pages(reports::text_of_pdf(read_bytes(pdf)));
  int n_pages = 0;
  for (std::string page; std::getline(pages, page, '\f');) {
    EXPECT_THAT(page, HasSubstr("TEST KEY"));
    EXPECT_THAT(page, HasSubstr("K-2026-0017"));
    ++n_pages;
  }
  EXPECT_GE(n_pages, 2);
}

TEST_F(Certify, SaysTheSameNumbersInThePdfAndInTheXml) {
  const std::string text = reports::text_of_pdf(bytes("certificate/certificate.pdf")),
                    xml = bytes("certificate/certificate.xml");
  EXPECT_GT(reports::number_words(text).size(), 150u);  // the comparison has something to compare
  EXPECT_THAT(reports::differences(text, xml, "certificate.xml"), testing::IsEmpty());
  std::string other = text;
  other.replace(other.find("0.0612"), 6, "0.0613");
  EXPECT_THAT(reports::differences(other, xml, "certificate.xml"), testing::SizeIs(2));  // unknown there, missing here
  other = text;
  other.replace(other.find("mm", other.find("0.0612")), 2, "µm");
  EXPECT_THAT(reports::differences(other, xml, "certificate.xml"), testing::Not(testing::IsEmpty()));
}

TEST_F(Certify, GivesTheSameBytesAgain) {
  ASSERT_EQ(run_fringecal(certify({path("verification.json")}, "again")).exit_code, 0);
  for (const auto* file : {"certificate.html", "certificate.xml", "certificate.pdf", "certificate.pdf.p7s", "data.zip",
                           "figures/volume-1.svg"}) {
    EXPECT_EQ(bytes(std::string("certificate/") + file), bytes(std::string("again/") + file)) << file;
  }
}

TEST_F(Certify, PutsItsDataBesideAndNoticesWhenTheyAreAltered) {
  const std::string zip = path("certificate/data.zip");
  EXPECT_EQ(test::run({"unzip", "-tq", zip}).status, 0);
  const auto inside = [&](const std::string& name) { return test::run({"unzip", "-p", zip, name}).output; };
  EXPECT_EQ(inside("verification-1.json"), bytes("verification.json"));
  EXPECT_EQ(inside("record-1/clouds/flat-02-1.ply"), bytes("clouds/flat-02-1.ply"));
  EXPECT_EQ(inside("figures/maps-1.svg"), bytes("certificate/figures/maps-1.svg"));
  EXPECT_THAT(inside("results.csv"), HasSubstr("0.0612"));
  const Value contents = parse_json(inside("contents.json"), "contents.json");
  for (const Value& file : *contents.find("files")->if_array()) {
    EXPECT_EQ(sha256_hex(inside(*file.find("name")->if_text())), *file.find("sha256")->if_text());
  }
  fs::copy(path("certificate"), path("other-data"), fs::copy_options::recursive);
  std::string altered = bytes("certificate/data.zip");
  altered[altered.size() / 2] ^= 1;
  write_atomically(path("other-data/data.zip"), altered);
  const auto check = [&] { return run_fringecal({"check", path("other-data"), "--trust", path("lab.pem")}); };
  EXPECT_EQ(check().exit_code, 2);
  EXPECT_THAT(check().errors, HasSubstr("data.zip is not the one that was certified"));
  fs::remove(path("other-data/data.zip"));
  EXPECT_THAT(check().errors, HasSubstr("data.zip is missing"));
}

TEST_F(Certify, RefusesAResidualCloudThatTheRecordDoesNotName) {
  fs::create_directories(path("forged"));
  fs::copy(path("verification.json"), path("forged/verification.json"));
  fs::copy(path("clouds"), path("forged/clouds"), fs::copy_options::recursive);
  std::string cloud = bytes("clouds/bar-00-1.ply");
  cloud.back() ^= 1;
  write_atomically(path("forged/clouds/bar-00-1.ply"), cloud);
  const auto made = run_fringecal(certify({path("forged/verification.json")}, "from-forged"));
  EXPECT_EQ(made.exit_code, 2);
  EXPECT_THAT(made.errors, HasSubstr("bar-00-1.ply: not the residual cloud that the record names"));
  EXPECT_FALSE(fs::exists(path("from-forged")));
}

TEST_F(Certify, IsTimeStampedByAnAuthorityOrNotIssued) {
  const test::StampingAuthority authority(*folder_ / "authority");
  auto record = test::sample_verification();
  ::unsetenv("SOURCE_DATE_EPOCH");  // an authority reads its own clock; so must the certificate
  const std::string now = utc_now();
  record.begun = record.ended = now.substr(0, 10) + "T00:00:00Z";
  write_atomically(path("today.json"), to_json(metrology::to_value(record)));
  std::string customer = test::sample_customer();
  customer.replace(customer.find("2026-11-18"), 10, now.substr(0, 10));
  write_atomically(path("customer-today.toml"), customer);
  auto arguments = certify({path("today.json")}, "stamped", {"--timestamp", authority.url()});
  *std::find(arguments.begin(), arguments.end(), path("customer.toml")) = path("customer-today.toml");
  const auto made = run_fringecal(arguments);
  *std::find(arguments.begin(), arguments.end(), path("stamped")) = path("not-stamped");
  *std::find(arguments.begin(), arguments.end(), authority.url()) = authority.url("/status");
  const auto refused = run_fringecal(arguments);
  ::setenv("SOURCE_DATE_EPOCH", "1795330800", 1);
  ASSERT_EQ(made.exit_code, 0) << made.errors;
  EXPECT_EQ(authority.answers_given(), 2);
  EXPECT_EQ(refused.exit_code, 3);
  EXPECT_FALSE(fs::exists(path("not-stamped")));
  const auto check = [&](const std::string& root) {
    return run_fringecal({"check", path("stamped"), "--trust", path("lab.pem"), "--trust-timestamp", root});
  };
  EXPECT_THAT(check(authority.root()).output, HasSubstr("XML time-stamped " + now.substr(0, 10)));
  EXPECT_EQ(check(authority.root()).exit_code, 0);
  EXPECT_THAT(check(path("lab.pem")).errors, HasSubstr("PDF: the time stamp does not hold"));
  EXPECT_THAT(run_fringecal({"check", path("stamped"), "--trust", path("lab.pem")}).output,
              HasSubstr("who was not judged"));
  fs::rename(path("stamped/certificate.pdf.tsr"), path("stamped/certificate.xml.tsr"));
  EXPECT_THAT(check(authority.root()).errors, HasSubstr("XML: the time stamp does not hold"));
}

// PTB's Schematron rules by an evaluator of XPath 2 that is not ours; each altered certificate violates one of them.
TEST_F(Certify, FollowsTheSchematronRules) {
  const fs::path rules = kSchemas / "dcc.sch";
  if (!fs::exists(rules)) GTEST_SKIP() << "shared data not present: " << rules;
  const std::string python = "/usr/bin/python3";  // Debian's own, which sees Debian's packages
  if (!fs::exists(python) || test::run({python, "-c", "import elementpath, lxml"}).status != 0) {
    GTEST_SKIP() << "python3-elementpath or python3-lxml is not installed";
  }
  const auto judged = [&](const std::string& file) {
    return test::run({python, FRINGECAL_SOURCE_DIR "/tests/reports/schematron.py", rules.string(), file});
  };
  ASSERT_EQ(run_fringecal(certify({path("verification.json")}, "german", {"--language", "de"})).exit_code, 0);
  for (const char* name : {"certificate/certificate.xml", "german/certificate.xml"}) {
    const auto outcome = judged(path(name));
    EXPECT_EQ(outcome.status, 0) << outcome.output << outcome.errors;
    EXPECT_THAT(outcome.output, Not(HasSubstr("warning"))) << outcome.output;
  }
  const std::string xml = bytes("certificate/certificate.xml");
  for (const auto& [from, to] : {std::pair("<dcc:release>[^<]*", "<dcc:release>?"),
                                 std::pair("<dcc:endPerformanceDate>[^<]*", "<dcc:endPerformanceDate>1999-01-01"),
                                 std::pair("dcc:usedMethods", "dcc:others")}) {
    write_atomically(path("ruled.xml"), std::regex_replace(xml, std::regex(from), to));
    const auto outcome = judged(path("ruled.xml"));
    EXPECT_EQ(outcome.status, 1) << to;
    EXPECT_THAT(outcome.output, HasSubstr("error: ")) << to << outcome.errors;
  }
}

TEST_F(Certify, NeedsNoNetwork) {
  const std::vector<std::string> alone = {"unshare", "--map-root-user", "--net"};
  if (test::run({alone[0], alone[1], alone[2], "true"}).status != 0)
    GTEST_SKIP() << "network namespaces are not permitted here";
  std::vector<std::string> arguments = alone;
  arguments.insert(arguments.end(), {"env", "SOURCE_DATE_EPOCH=1795330800", FRINGECAL_PROGRAM});
  const auto call = certify({path("verification.json")}, "alone");
  arguments.insert(arguments.end(), call.begin(), call.end());
  const auto made = test::run(arguments);
  ASSERT_EQ(made.status, 0) << made.errors;
  EXPECT_EQ(bytes("alone/certificate.pdf"), bytes("certificate/certificate.pdf"));
}

TEST_F(Certify, FromAHistoryEntersItselfAndIsBoundToIt) {
  const std::string file = path("history.db");
  metrology::History(file, metrology::History::Access::write)
      .append("verification", metrology::to_value(test::sample_verification()), "2026-11-22T09:00:00Z");
  const auto made = run_fringecal(certify({"1"}, "from-history", {"--history", file, "--language", "de"}));
  ASSERT_EQ(made.exit_code, 0) << made.errors;
  // The entry is two hours later than the clock of this test: as if that had been set back since.
  EXPECT_THAT(made.errors, HasSubstr("its newest entry is of 2026-11-22T09:00:00Z, but this machine's clock shows "
                                     "2026-11-22T07:00:00Z; set the clock"));
  const auto twice = run_fringecal(certify({"1"}, "twice", {"--history", file}));
  EXPECT_EQ(twice.exit_code, 2);
  EXPECT_THAT(twice.errors, HasSubstr("was issued already"));
  const auto checked = run_fringecal({"check", path("from-history"), "--trust", path("lab.pem"), "--history", file});
  EXPECT_EQ(checked.exit_code, 0) << checked.errors;
  EXPECT_THAT(checked.output, HasSubstr("its chain unbroken"));
  // The certificate is an entry itself: a PDF and XML of the same number that were issued elsewhere are not those.
  EXPECT_THAT(checked.output, HasSubstr("the certificate is entry 2"));
  const std::string other = path("other.db");
  metrology::History(other, metrology::History::Access::write)
      .append("verification", metrology::to_value(test::sample_verification(0.001)), "2026-11-20T11:00:00Z");
  EXPECT_EQ(run_fringecal({"check", path("from-history"), "--trust", path("lab.pem"), "--history", other}).exit_code,
            2);
}

TEST_F(Certify, IsNotFooledByAPdfOfAnotherCertificate) {
  fs::copy(path("certificate"), path("mixed"), fs::copy_options::recursive);
  std::string pdf = bytes("mixed/certificate.pdf");
  pdf[pdf.size() / 2] ^= 1;
  write_atomically(path("mixed/certificate.pdf"), pdf);
  const auto checked = run_fringecal({"check", path("mixed"), "--trust", path("lab.pem")});
  EXPECT_EQ(checked.exit_code, 2);
  EXPECT_THAT(checked.errors, HasSubstr("signature of the PDF does not hold"));
}

TEST_F(Certify, WritesAReportShortOfACertificate) {
  const auto made = run_fringecal({"report", path("verification.json"), "-o", path("report")});
  ASSERT_EQ(made.exit_code, 0) << made.errors;
  EXPECT_THAT(bytes("report/report.html"), HasSubstr("Verification report"));
  EXPECT_TRUE(bytes("report/report.pdf").starts_with("%PDF-1.7"));
}

}  // namespace
}  // namespace fringecal
