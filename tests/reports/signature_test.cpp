#include "reports/signature.h"

#include "core/error.h"
#include "core/file.h"
#include "reports/signing_key.h"
#include "reports/xml_document.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_key.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openssl/evp.h>

#include <string>

namespace fringecal::reports {
namespace {

using test::make_test_key;
using test::message_of;
using test::TemporaryFolder;
using testing::HasSubstr;

const std::string kXml =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<dcc:digitalCalibrationCertificate xmlns:dcc=\"https://ptb.de/dcc\" "
    "schemaVersion=\"3.3.0\"><dcc:value unit=\"mm\">0.0123</dcc:value><!-- seen "
    "--></dcc:digitalCalibrationCertificate>\n";

std::string no_passphrase() { throw std::logic_error("nobody asks"); }

SigningKey load(const TemporaryFolder& folder, const std::string& name) {
  return SigningKey::load(folder / (name + ".key"), folder / (name + ".pem"), &no_passphrase);
}

std::string unhex(const std::string& hex) {
  std::string out;
  for (std::size_t k = 0; k < hex.size(); k += 2) out += static_cast<char>(std::stoi(hex.substr(k, 2), nullptr, 16));
  return out;
}

TEST(EcdsaWithoutChance, IsTheExampleOfRfc6979) {
  // RFC 6979, A.2.5: P-256, SHA-256, message "sample". The key as RFC 5915 DER: version 1, the secret, the curve's name.
  const std::string der = unhex("30310201010420") +
                          unhex("C9AFA9D845BA75166B5C215767B1D6934E50C3DB36E89B127B8A622B120F6721") +
                          unhex("A00A06082A8648CE3D030107");
  const auto* bytes = reinterpret_cast<const unsigned char*>(der.data());
  SigningKey::State state;
  state.key.reset(d2i_PrivateKey(EVP_PKEY_EC, nullptr, &bytes, static_cast<long>(der.size())));
  ASSERT_NE(state.key, nullptr);
  EXPECT_EQ(ecdsa_sha256(state, "sample"), unhex("EFD48B2AACB6A8FD1140DD9CD45E81D69D2C877B56AAF991C34D0EA84EAF3716"
                                                 "F7CB1C942D657C41D436C7A1B6E29F65F3E900DBB9AFF4064DC4AB2F843ACDA8"));
}

class SignatureOfKind : public testing::TestWithParam<const char*> {};

TEST_P(SignatureOfKind, HoldsForUsAndForXmlsec1AndIsTheSameEachTime) {
  const TemporaryFolder folder;
  make_test_key(folder.path(), "lab", GetParam());
  const SigningKey key = load(folder, "lab");
  EXPECT_TRUE(key.is_test());
  const std::string once = sign_xml(kXml, key);
  EXPECT_EQ(once, sign_xml(kXml, key));
  EXPECT_EQ(sign_detached("content", key), sign_detached("content", key));
  const auto verdict = verify_xml(once, {folder / "lab.pem"});
  EXPECT_TRUE(verdict.present);
  EXPECT_EQ(verdict.fault, "");
  EXPECT_THAT(verdict.subject, HasSubstr("CN=fringecal TEST key"));
  const auto file = folder.write("signed.xml", once);
  const auto outside =
      test::run({"xmlsec1", "--verify", "--trusted-pem", (folder / "lab.pem").string(), file.string()});
  EXPECT_EQ(outside.status, 0) << outside.errors;
  EXPECT_EQ(verify_detached("content", sign_detached("content", key), {folder / "lab.pem"}).fault, "");
}
INSTANTIATE_TEST_SUITE_P(Kinds, SignatureOfKind, testing::Values("ec", "rsa"));

TEST(Signature, OfAnotherLaboratoryIsNotTrusted) {
  const TemporaryFolder folder;
  make_test_key(folder.path(), "lab", "ec");
  make_test_key(folder.path(), "forger", "ec", "/C=DE/O=Example/CN=fringecal TEST key");
  const SigningKey forger = load(folder, "forger");
  const std::string forged = sign_xml(kXml, forger), forged_pdf = sign_detached("content", forger);
  EXPECT_THAT(verify_xml(forged, {folder / "lab.pem"}).fault, HasSubstr("trusted"));
  EXPECT_NE(verify_detached("content", forged_pdf, {folder / "lab.pem"}).fault, "");
  EXPECT_EQ(verify_xml(forged, {}).fault, "");  // intact, whoever signed it
}

TEST(Signature, BreaksWithTheContent) {
  const TemporaryFolder folder;
  make_test_key(folder.path(), "lab", "ec");
  const SigningKey key = load(folder, "lab");
  std::string altered = sign_xml(kXml, key);
  altered.replace(altered.find("0.0123"), 6, "0.0128");
  EXPECT_THAT(verify_xml(altered, {}).fault, HasSubstr("altered"));
  EXPECT_NE(verify_detached("contenT", sign_detached("content", key), {}).fault, "");
  EXPECT_NE(verify_detached("content", "no signature", {}).fault, "");
}

TEST(Signature, WithAReferenceToAPartOrAnotherTransformIsRefused) {
  const TemporaryFolder folder;
  make_test_key(folder.path(), "lab", "rsa");
  const std::string good = sign_xml(kXml, load(folder, "lab"));
  std::string part = good, xslt = good;
  part.replace(part.find("URI=\"\""), 6, "URI=\"#x\"");
  const std::string enveloped = "http://www.w3.org/2000/09/xmldsig#enveloped-signature";
  xslt.replace(xslt.find(enveloped), enveloped.size(), "http://www.w3.org/TR/1999/REC-xslt-19991116");
  EXPECT_NE(verify_xml(part, {}).fault, "");
  EXPECT_NE(verify_xml(xslt, {}).fault, "");
}

TEST(SigningKey, ThatOthersMayReadIsRefused) {
  const TemporaryFolder folder;
  make_test_key(folder.path(), "lab", "ec");
  std::filesystem::permissions(folder / "lab.key", std::filesystem::perms::group_read,
                               std::filesystem::perm_options::add);
  EXPECT_THAT(message_of<InputError>([&] { load(folder, "lab"); }), HasSubstr("chmod 600"));
}

TEST(SigningKey, WithoutItsCertificateIsRefused) {
  const TemporaryFolder folder;
  make_test_key(folder.path(), "lab", "ec");
  make_test_key(folder.path(), "other", "ec");
  EXPECT_THAT(
      message_of<InputError>([&] { SigningKey::load(folder / "lab.key", folder / "other.pem", &no_passphrase); }),
      HasSubstr("no certificate that belongs to this key"));
}

TEST(SigningKey, InPkcs12OpensWithItsPassphraseOnly) {
  const TemporaryFolder folder;
  make_test_key(folder.path(), "lab", "ec");
  const std::string p12 = (folder / "lab.p12").string();
  folder.write("words", "right\n");
  ASSERT_EQ(test::run({"openssl", "pkcs12", "-export", "-inkey", (folder / "lab.key").string(), "-in",
                       (folder / "lab.pem").string(), "-out", p12, "-passout", "file:" + (folder / "words").string()})
                .status,
            0);
  std::filesystem::permissions(p12, std::filesystem::perms::owner_read);
  EXPECT_TRUE(SigningKey::load(p12, std::nullopt, [] { return std::string("right"); }).is_test());
  const auto message =
      message_of<InputError>([&] { SigningKey::load(p12, std::nullopt, [] { return std::string("wrong-words"); }); });
  EXPECT_THAT(message, HasSubstr("passphrase"));
  EXPECT_THAT(message, testing::Not(HasSubstr("wrong-words")));
}

TEST(XmlDocument, RefusesHostileDocuments) {
  const auto refused = [](const std::string& xml) {
    return message_of<InputError>([&] { XmlDocument::parse(xml, "x.xml"); });
  };
  std::string bomb = "<!DOCTYPE a [<!ENTITY a \"aaaaaaaaaa\">";
  for (char c = 'b'; c < 'k'; ++c) {
    bomb += std::string("<!ENTITY ") + c + " \"";
    for (int k = 0; k < 10; ++k) bomb += std::string("&") + static_cast<char>(c - 1) + ";";
    bomb += "\">";
  }
  EXPECT_THAT(refused(bomb + "]><a>&j;</a>"), HasSubstr("DOCTYPE"));
  EXPECT_THAT(refused("<!DOCTYPE a SYSTEM \"http://example.org/a.dtd\"><a/>"), HasSubstr("DOCTYPE"));
  EXPECT_THAT(refused("<!DOCTYPE a [<!ENTITY b SYSTEM \"file:///etc/passwd\">]><a>&b;</a>"), HasSubstr("DOCTYPE"));
  std::string deep;
  for (int k = 0; k < 5'000'000; ++k) deep += "<a>";
  EXPECT_THAT(refused(deep), HasSubstr("not XML that is read here"));
  EXPECT_THAT(refused(std::string((64u << 20) + 1, ' ')), HasSubstr("at most"));
  EXPECT_THAT(refused(""), HasSubstr("not XML"));
}

}  // namespace
}  // namespace fringecal::reports
