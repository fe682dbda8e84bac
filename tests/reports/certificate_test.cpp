#include "reports/certificate.h"

#include "core/error.h"
#include "core/file.h"
#include "reports/artefact_certificate.h"
#include "reports/certificate_check.h"
#include "reports/certificate_dcc.h"
#include "reports/certificate_html.h"
#include "reports/dcc_result.h"
#include "reports/xml_document.h"
#include "tests/support/sample_verification.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_key.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <string>

namespace fringecal::reports {
namespace {

using test::message_of;
using test::TemporaryFolder;
using testing::HasSubstr;
using testing::Not;

const std::filesystem::path kData = FRINGECAL_SHARED_DATA;
const std::filesystem::path kSchema = kData / "dcc-schema/v3.3.0/dcc.xsd";

Certificate sample(const std::string& free_text = "Two light scratches.", const std::string& language = "en") {
  const TemporaryFolder folder;
  Certificate c;
  c.number = "K-2026-0017";
  c.language = language;
  c.issued = "2026-11-22T09:00:00Z";
  c.laboratory = read_laboratory(folder.write("lab.toml", test::sample_laboratory()));
  c.customer = read_customer(folder.write("customer.toml", test::sample_customer(free_text)));
  c.records.emplace_back();
  auto& record = c.records.front();
  record.verification = test::sample_verification();
  record.document = to_json(metrology::to_value(record.verification));
  record.sha256 = sha256_hex(record.document);
  return c;
}

/// Not valid after the schema, by an independent program; "" where it is.
std::string xmllint_fault(const std::string& xml) {
  const auto out = test::run({"xmllint", "--nonet", "--noout", "--schema", kSchema.string(), "-"}, xml);
  return out.status == 0 ? "" : out.errors.substr(0, 600);
}

TEST(ResultLine, HasUWithTwoDigitsAndTheValueToTheSamePlace) {
  const Certificate c = sample();
  const auto lines = result_lines(c);
  ASSERT_EQ(lines.size(), 13u);
  // u = sqrt(0.2^2 + 1.3^2 + 0.21^2 + 0.34^2 + 0.4^2) um = 1.432 um, nu = 9 (1.432 / 1.3)^4 -> 13, k = t_0.9545(13) = 2.21,
  // U = 3.2 um [GUM, G.3.2].
  EXPECT_EQ(lines[0].value, "0.0612");
  EXPECT_EQ(lines[0].U, "0.0032");
  EXPECT_EQ(lines[0].k, "2.21");
  EXPECT_EQ(lines[0].coverage_percent, "95.45");
  EXPECT_EQ(lines[3].value, "-0.0041");
  EXPECT_EQ(lines[3].lower, "-0.03");
  EXPECT_EQ(stated(2.5e-9, 1e-10).value, "2.50E-9");  // an XML number as well
  EXPECT_EQ(stated(1234.5678, 12).value, "1235");
}

TEST(Catalogue, HasTheSameKeysAndBracesInEveryLanguage) {
  const auto& english = Catalogue::in("en");
  const auto braces = [](const std::string& text) {
    std::multiset<std::string> out;
    for (auto at = text.find('{'); at != std::string::npos; at = text.find('{', at + 1)) {
      out.insert(text.substr(at, text.find('}', at) - at));
    }
    return out;
  };
  for (const auto& language : Catalogue::languages()) {
    const auto& other = Catalogue::in(language);
    ASSERT_EQ(english.keys(), other.keys()) << language;
    for (const auto& key : english.keys()) {
      if (key.starts_with("names.")) continue;
      EXPECT_EQ(braces(english(key)), braces(other(key))) << language << " " << key;
    }
  }
  EXPECT_THAT(message_of<InputError>([] { Catalogue::in("eo"); }), HasSubstr("known: en, de"));
}

TEST(Certificate, SaysWhatTheStandardAsksFor) {
  // ISO/IEC 17025:2017, 7.8.2.1 a to p, 7.8.4.1, 7.8.6.2, each by the words that carry it.
  const std::string html = certificate_html(sample());
  for (const char* words : {"Calibration certificate",
                            "Kalibrierlaboratorium Beispiel GmbH",
                            "in the laboratory",
                            "K-2026-0017",
                            "End of certificate",
                            "Formenbau Beispiel &amp; Söhne KG",
                            "VDI/VDE 2634 part 2 (2012)",
                            "0007-2026",
                            "Two light scratches.",
                            "2026-11-18",
                            "2026-11-20",
                            "2026-11-22",
                            "relate only to the items calibrated",
                            "0.0612\u00a0mm",
                            "Dr. Erika Mustermann",
                            "Deviations from the method",
                            "Air temperature",
                            "(20.30 ± 0.30)\u00a0°C",
                            "expanded measurement uncertainty",
                            "traceable to the SI",
                            "K-2026-0815",
                            "Decision rule",
                            "ISO 14253-1:2017",
                            "not proved",
                            "2027-11-30"}) {
    EXPECT_THAT(html, HasSubstr(words));
  }
  Certificate agreed = sample();
  agreed.customer.recalibration_date.clear();
  EXPECT_THAT(certificate_html(agreed), Not(HasSubstr("Recalibration")));
  agreed.customer.amendment = Amendment{true, "K-2026-0016", "wrong serial number"};
  EXPECT_THAT(certificate_html(agreed), HasSubstr("replaces certificate no. K-2026-0016"));
}

TEST(Certificate, LoadsNothingFromOutside) {
  for (const auto& html :
       {certificate_html(sample()), certificate_html(sample("<img src=\"http://example.org/x.png\">"))}) {
    for (const char* loader : {"<img", "<link", "<script", "url(", "@import", "src=\"", "<iframe", "<object"}) {
      EXPECT_EQ(html.find(loader), std::string::npos) << loader;
    }
  }
}

TEST(Certificate, OfATestKeySaysSo) {
  Certificate c = sample();
  EXPECT_THAT(certificate_html(c), Not(HasSubstr("TEST KEY")));
  c.signer = Signer{"CN=fringecal TEST key", true};
  EXPECT_THAT(certificate_html(c), HasSubstr("TEST KEY"));
  EXPECT_THAT(certificate_dcc(c), HasSubstr("TEST KEY"));
}

TEST(CertificateXml, IsValidAfterTheSchemaWhateverTheFreeTexts) {
  if (!std::filesystem::exists(kSchema)) GTEST_SKIP() << "shared data not present: dcc-schema";
  std::string long_text;
  while (long_text.size() < 10'000) long_text += "Ein langer Satz mit Umlauten äöüß & <Klammern>. ";
  for (const std::string& text : {std::string("plain"), std::string("a < b & c > d \" ' ]]> <!-- --> &amp; &#1;"),
                                  std::string("Prüfling: Größe 3 µm, 95 %"), std::string("三维扫描仪，条纹投影"),
                                  long_text, std::string(10'000, 'x'), std::string("\uFFFF \uFFFE tab\tnext\nline")}) {
    for (const char* language : {"en", "de"}) {
      Certificate c = sample(text, language);
      c.number = "K 1/2 <\u4e09>";
      const std::string xml = certificate_dcc(c);
      EXPECT_EQ(xmllint_fault(xml), "") << text.substr(0, 40);
      const auto ours = XmlDocument::parse(xml, "certificate.xml").fault_after_schema(kSchema);
      EXPECT_FALSE(ours) << *ours;
    }
  }
}

TEST(CertificateXml, WithAdjustmentAmendmentAndEveryVerdictIsValid) {
  if (!std::filesystem::exists(kSchema)) GTEST_SKIP() << "shared data not present: dcc-schema";
  Certificate c = sample();
  c.records.push_back(c.records.front());
  c.records.front().as_found = true;
  c.records.back().entry = 3;
  c.records.back().entry_hash = std::string(64, 'b');
  c.customer.amendment = Amendment{false, "K-2026-0016", ""};
  using metrology::Verdict;
  int k = 0;
  for (const auto verdict :
       {Verdict::pass, Verdict::conditional_pass, Verdict::not_proved, Verdict::conditional_fail, Verdict::fail}) {
    c.records.front().verification.quantities[static_cast<std::size_t>(k++)].judgement->verdict = verdict;
  }
  const std::string xml = certificate_dcc(c);
  EXPECT_EQ(xmllint_fault(xml), "");
  EXPECT_THAT(xml, HasSubstr("beforeAdjustment"));
  EXPECT_THAT(xml, HasSubstr("conditionalFail"));
  const auto measurements = dcc_measurements(XmlDocument::parse(xml, "certificate.xml"));
  ASSERT_EQ(measurements.size(), 2u);
  EXPECT_EQ(measurements[1].entry, 3);
  EXPECT_EQ(measurements[1].entry_hash, std::string(64, 'b'));
  EXPECT_EQ(measurements[1].record, c.records[1].document);
  EXPECT_EQ(measurements[1].results.size(), 13u);
}

TEST(CheckCertificate, JudgesTheExamplesOfOthersRightly) {
  if (!std::filesystem::exists(kData / "dcc-examples")) GTEST_SKIP() << "shared data not present: dcc-examples";
  const auto fault = [](const char* name, bool any_signer) {
    CheckRequest request{.xml = read_bytes(kData / "dcc-examples" / name), .xml_name = name};
    request.schema = kSchema;
    request.any_signer = any_signer;
    return check_certificate(request).fault;
  };
  EXPECT_EQ(fault("valid.xml", true), "");
  EXPECT_THAT(fault("valid.xml", false), HasSubstr("not signed"));
  EXPECT_EQ(fault("valid_signature.xml", true), "");
  EXPECT_THAT(fault("valid_signature.xml", false), HasSubstr("--trust"));
  EXPECT_THAT(fault("invalid_schema.xml", true), HasSubstr("not valid after the schema"));
  EXPECT_THAT(fault("invalid_signature.xml", true), HasSubstr("altered after it was signed"));
  EXPECT_THAT(fault("dcc_gp_temperature_typical_v12.xml", true), HasSubstr("not valid after the schema"));
}

TEST(CheckCertificate, FindsAResultThatDoesNotFollowFromItsRecord) {
  std::string xml = certificate_dcc(sample());
  CheckRequest request{.xml = xml, .xml_name = "certificate.xml"};
  request.any_signer = true;
  EXPECT_EQ(check_certificate(request).fault, "");
  const auto at = xml.find("<si:value>0.0612</si:value>");
  ASSERT_NE(at, std::string::npos);
  request.xml.replace(at, 27, "<si:value>0.0512</si:value>");
  EXPECT_THAT(check_certificate(request).fault, HasSubstr("certified as 0.0512, the record gives 0.0612"));
}

TEST(NumberWords, AreFoundWithTheirUnits) {
  const auto words = number_words("U = (20.30 ± 0.30)\u00a0°C; K-2026-17, 95.45\u00a0% at \u22120.03\u00a0mm.");
  std::vector<std::pair<std::string, std::string>> got;
  for (const auto& w : words) got.emplace_back(w.word, w.unit);
  EXPECT_THAT(got, testing::ElementsAre(std::pair("20.30", ""), std::pair("0.30", "°C"), std::pair("K-2026-17", ""),
                                        std::pair("95.45", "%"), std::pair("-0.03", "mm")));
}

TEST(Laboratory, RefusesHostileAndWrongFiles) {
  const TemporaryFolder folder;
  const auto refused = [&](const std::string& toml) {
    return message_of<InputError>([&] { read_laboratory(folder.write("lab.toml", toml)); });
  };
  EXPECT_THAT(refused(std::string(2'000'000, '#')), HasSubstr("at most 1000000"));
  EXPECT_NE(refused("a = " + std::string(100'000, '[')), "");
  std::string wrong = test::sample_laboratory();
  wrong.replace(wrong.find("country_code = \"DE\""), 19, "country_code = \"Germany\"");
  EXPECT_THAT(refused(wrong), HasSubstr("ISO 3166-1"));
  EXPECT_THAT(refused(test::sample_laboratory() + "unknown = 1\n"), HasSubstr("unknown"));
}

TEST(ArtefactCertificate, IsReadWithUnitsUncertaintyAndTraceability) {
  EXPECT_EQ(shifted("0.0300043", 3), "30.0043");
  EXPECT_EQ(shifted("4.3E-6", 3), "0.0043");
  EXPECT_EQ(shifted("-12", -3), "-0.012");
  EXPECT_EQ(shifted("30", 0), "30");
  EXPECT_EQ(shifted("0.5", 3), "500");
  EXPECT_THROW(shifted("12x", 0), InputError);
  const std::string xml =
      R"(<?xml version="1.0"?><dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si" schemaVersion="3.3.0">
<dcc:administrativeData><dcc:coreData><dcc:uniqueIdentifier>15061 PTB 26</dcc:uniqueIdentifier><dcc:endPerformanceDate>2026-03-01</dcc:endPerformanceDate></dcc:coreData>
<dcc:items><dcc:item><dcc:name><dcc:content>Sphere 30</dcc:content></dcc:name></dcc:item></dcc:items>
<dcc:calibrationLaboratory><dcc:calibrationLaboratoryCode>D-K-15000</dcc:calibrationLaboratoryCode></dcc:calibrationLaboratory></dcc:administrativeData>
<dcc:measurementResults><dcc:measurementResult><dcc:results><dcc:result><dcc:data>
<dcc:quantity><dcc:name><dcc:content lang="de">Durchmesser</dcc:content></dcc:name><si:real><si:value>0.0300043</si:value><si:unit>\metre</si:unit>
<si:expandedUnc><si:uncertainty>6e-7</si:uncertainty><si:coverageFactor>2</si:coverageFactor><si:coverageProbability>0.95</si:coverageProbability></si:expandedUnc></si:real></dcc:quantity>
<dcc:quantity><dcc:name><dcc:content>Sphericity</dcc:content></dcc:name><si:real><si:value>0.4</si:value><si:unit>\micro\metre</si:unit>
<si:measurementUncertaintyUnivariate><si:standardMU><si:valueStandardMU>0.1</si:valueStandardMU></si:standardMU></si:measurementUncertaintyUnivariate></si:real></dcc:quantity>
</dcc:data></dcc:result></dcc:results></dcc:measurementResult></dcc:measurementResults></dcc:digitalCalibrationCertificate>)";
  const auto certificate = artefact_certificate(XmlDocument::parse(xml, "s.xml"), "s.xml");
  ArtefactEntry entry{.kind = "sphere", .valid_until = "2028-03-01", .expansion_per_K = 11.5e-6};
  const std::string toml = artefact_toml(certificate, entry, "s.xml");
  for (const char* line : {"name = \"Sphere 30\"", "diameter_mm = 30.0043", "U_diameter_mm = 0.0006",
                           "form_mm = 0.0004", "k = 2", "U_form_mm = 0.0002", "certificate = \"15061 PTB 26\"",
                           "laboratory = \"D-K-15000\"", "date = \"2026-03-01\""}) {
    EXPECT_THAT(toml, HasSubstr(line));
  }
  EXPECT_NO_THROW(parse_toml(toml, "artefacts.toml"));
  entry.kind = "ball_bar";
  EXPECT_THAT(message_of<InputError>([&] { artefact_toml(certificate, entry, "s.xml"); }),
              HasSubstr("needs 2 certified diameters and a distance"));
}

std::string ball_bar_dcc(const std::string& results) {
  return R"(<?xml version="1.0"?><dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si" schemaVersion="3.3.0">
<dcc:administrativeData><dcc:coreData><dcc:uniqueIdentifier>7</dcc:uniqueIdentifier><dcc:issueDate>2026-03-01</dcc:issueDate></dcc:coreData>
<dcc:items><dcc:item><dcc:name><dcc:content>Bar</dcc:content></dcc:name></dcc:item></dcc:items></dcc:administrativeData>
<dcc:measurementResults><dcc:measurementResult><dcc:results>)" +
         results +
         "</dcc:results></dcc:measurementResult></dcc:measurementResults></dcc:digitalCalibrationCertificate>";
}

std::string dcc_length(const std::string& ref_type, const std::string& name, const std::string& mm) {
  return "<dcc:quantity" + (ref_type.empty() ? "" : " refType=\"" + ref_type + "\"") + "><dcc:name><dcc:content>" +
         name + "</dcc:content></dcc:name><si:real><si:value>" + mm +
         "</si:value><si:unit>\\milli\\metre</si:unit><si:expandedUnc><si:uncertainty>0.001</si:uncertainty>"
         "<si:coverageFactor>2</si:coverageFactor></si:expandedUnc></si:real></dcc:quantity>";
}

std::string ball_bar_entry(const std::string& results) {
  const auto certificate = artefact_certificate(XmlDocument::parse(ball_bar_dcc(results), "b.xml"), "b.xml");
  return artefact_toml(certificate, {.kind = "ball_bar", .valid_until = "2028-03-01"}, "b.xml");
}

TEST(ArtefactCertificate, IsReadByRefTypesBeforeNames) {
  // The names would tell the opposite; the second diameter has its type from the result around it.
  const std::string toml = ball_bar_entry(
      "<dcc:result><dcc:data>" + dcc_length("geometry_sphereDiameter basic_measuredValue", "Distance 1", "30.001") +
      dcc_length("geometry_centreDistance", "Diameter", "150.013") +
      dcc_length("geometry_sphereDiameter basic_nominalValue", "Diameter", "30") +
      "</dcc:data></dcc:result><dcc:result refType=\"geometry_sphereDiameter\"><dcc:data><dcc:list>" +
      dcc_length("basic_measuredValue", "B", "30.002") + "</dcc:list></dcc:data></dcc:result>");
  EXPECT_THAT(toml, HasSubstr("diameter_mm = [30.001, 30.002]"));
  EXPECT_THAT(toml, HasSubstr("distance_mm = 150.013"));
  EXPECT_THAT(toml, HasSubstr("# also certified: \"Diameter\" 30 mm"));  // the set point
}

TEST(ArtefactCertificate, IsReadByNamesOfManyLanguagesWhereThereAreNoRefTypes) {
  for (const auto& [diameter, distance] :
       {std::pair("Diamètre de la sphère", "Distance des centres"), std::pair("Diámetro", "Distancia entre centros"),
        std::pair("球直径", "球心距离"), std::pair("Kugeldurchmesser", "Abstand"),
        std::pair("Średnica kuli", "Odległość"), std::pair("Диаметр", "Расстояние")}) {
    const std::string toml = ball_bar_entry("<dcc:result><dcc:data>" + dcc_length("", diameter, "30.001") +
                                            dcc_length("", diameter, "30.002") + dcc_length("", distance, "150.013") +
                                            "</dcc:data></dcc:result>");
    EXPECT_THAT(toml, HasSubstr("diameter_mm = [30.001, 30.002]")) << diameter;
    EXPECT_THAT(toml, HasSubstr("distance_mm = 150.013")) << distance;
  }
}

}  // namespace
}  // namespace fringecal::reports
