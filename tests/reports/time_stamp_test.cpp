#include "reports/time_stamp.h"

#include "core/error.h"
#include "core/file.h"
#include "reports/signature.h"
#include "tests/support/stamping_authority.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_key.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <string>

namespace fringecal::reports {
namespace {

using test::message_of;
using test::StampingAuthority;
using testing::HasSubstr;
using testing::IsEmpty;
using namespace std::chrono_literals;

const std::string kContent = "the bytes of a certificate";

class TimeStamp : public testing::Test {
 protected:
  TimeStamp() : authority_(folder_ / "authority") {}
  test::TemporaryFolder folder_;
  StampingAuthority authority_;
};

TEST_F(TimeStamp, OfAnAuthorityHoldsForUsAndForOpenssl) {
  const std::string stamp = time_stamp(kContent, authority_.url());
  const auto verdict = verify_time_stamp(kContent, stamp, {authority_.root()});
  EXPECT_THAT(verdict.fault, IsEmpty());
  EXPECT_EQ(verdict.authority, "CN=TEST time stamps,O=Example");
  EXPECT_EQ(verdict.time.size(), std::string("2026-11-22T07:00:00Z").size());
  write_atomically(folder_ / "content", kContent);
  write_atomically(folder_ / "content.tsr", stamp);
  const auto openssl = test::run({"openssl", "ts", "-verify", "-data", (folder_ / "content").string(), "-in",
                                  (folder_ / "content.tsr").string(), "-CAfile", authority_.root().string()});
  EXPECT_EQ(openssl.status, 0) << openssl.errors;
}

TEST_F(TimeStamp, OfOtherContentIsRefused) {
  const std::string stamp = time_stamp(kContent, authority_.url());
  EXPECT_THAT(verify_time_stamp(kContent + " ", stamp, {authority_.root()}).fault, HasSubstr("imprint"));
  EXPECT_THAT(verify_time_stamp(kContent + " ", stamp, {}).fault, HasSubstr("imprint"));
}

TEST_F(TimeStamp, OfAnAuthorityThatIsNotTrustedIsRefused) {
  test::make_test_key(folder_.path(), "stranger", "ec", "/O=Example/CN=TEST stranger");
  const std::string stamp = time_stamp(kContent, authority_.url());
  EXPECT_THAT(verify_time_stamp(kContent, stamp, {folder_ / "stranger.pem"}).fault, HasSubstr("does not hold"));
  EXPECT_THAT(verify_time_stamp(kContent, stamp, {}).fault, IsEmpty());  // intact, not judged
}

TEST_F(TimeStamp, OfACertificateThatHadEndedIsRefused) {
  const StampingAuthority old(folder_ / "old", StampingAuthority::Validity::ended);
  const std::string stamp = old.answer(time_stamp_request(kContent));
  EXPECT_THAT(verify_time_stamp(kContent, stamp, {old.root()}).fault, HasSubstr("expired"));
  EXPECT_THAT(verify_time_stamp(kContent, stamp, {}).fault, HasSubstr("expired"));
  EXPECT_THAT(message_of<EnvironmentError>([&] { time_stamp(kContent, old.url()); }), HasSubstr("expired"));
}

TEST_F(TimeStamp, ThatIsGarbageOrCutOrAlteredIsRefused) {
  const std::string stamp = time_stamp(kContent, authority_.url());
  EXPECT_THAT(verify_time_stamp(kContent, "", {}).fault, HasSubstr("cannot be read"));
  EXPECT_THAT(verify_time_stamp(kContent, "no DER at all", {}).fault, HasSubstr("cannot be read"));
  EXPECT_THAT(verify_time_stamp(kContent, stamp.substr(0, stamp.size() - 1), {}).fault, HasSubstr("cannot be read"));
  // What of the DER is not covered by the signature says nothing about content or time: the verdict then is the same.
  const auto intact = verify_time_stamp(kContent, stamp, {authority_.root()});
  int refused = 0;
  for (std::size_t at = 0; at < stamp.size(); at += 7) {
    std::string altered = stamp;
    altered[at] = static_cast<char>(altered[at] ^ 1);
    const auto verdict = verify_time_stamp(kContent, altered, {authority_.root()});
    refused += verdict.fault.empty() ? 0 : 1;
    EXPECT_TRUE(!verdict.fault.empty() || verdict.time == intact.time) << "byte " << at;
  }
  EXPECT_GT(refused, static_cast<int>(stamp.size() / 7 / 2));  // most bytes are signature, token and certificate
}

TEST_F(TimeStamp, IsNotTakenFromAServerThatAnswersAnythingElse) {
  const auto refusal = [&](const std::string& path) {
    return message_of<EnvironmentError>([&] { time_stamp(kContent, authority_.url(path), {.together = 2s}); });
  };
  EXPECT_THAT(refusal("/status"), HasSubstr("status 500"));
  EXPECT_THAT(refusal("/moved"), HasSubstr("status 307"));
  EXPECT_EQ(authority_.answers_given(), 0);  // the redirect was not followed
  EXPECT_THAT(refusal("/html"), HasSubstr("text/html"));
  EXPECT_THAT(refusal("/long"), HasSubstr("longer than"));
  EXPECT_THAT(refusal("/nothing"), HasSubstr("status 404"));
  time_stamp(kContent, authority_.url());
  EXPECT_THAT(refusal("/replay"), HasSubstr("not the answer to this question"));  // same content, another nonce
}

TEST_F(TimeStamp, IsNotWaitedForWithoutEnd) {
  // Asked for in 2 s together; a loaded machine may take some seconds more to notice, a server's 30 s are never waited.
  for (const char* path : {"/silent", "/drip"}) {
    const auto begun = std::chrono::steady_clock::now();
    EXPECT_THAT(message_of<EnvironmentError>([&] { time_stamp(kContent, authority_.url(path), {.together = 2s}); }),
                HasSubstr("no answer"));
    EXPECT_LT(std::chrono::steady_clock::now() - begun, 15s) << path;
  }
}

TEST(TimeStampAddress, MustBeOneOfAServer) {
  for (const char* url : {"", "stamp.example.org", "ftp://example.org", "http://", "http:///path", "file:///etc/passwd",
                          "http://a b/", "http://a/\r\nX: y", "http://user:secret@example.org/"}) {
    EXPECT_THAT(message_of<InputError>([&] { time_stamp(kContent, url); }), HasSubstr("address of a server")) << url;
  }
}

}  // namespace
}  // namespace fringecal::reports
