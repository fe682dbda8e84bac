#include "reports/time_stamp.h"

#include "core/error.h"
#include "reports/http_post.h"
#include "reports/signing_key.h"

#include <fmt/format.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/rand.h>
#include <openssl/sha.h>
#include <openssl/ts.h>

#include <array>
#include <memory>

namespace fringecal::reports {
namespace {

struct Free {
  void operator()(BIO* x) const { BIO_free_all(x); }
  void operator()(TS_REQ* x) const { TS_REQ_free(x); }
  void operator()(TS_RESP* x) const { TS_RESP_free(x); }
  void operator()(TS_VERIFY_CTX* x) const { TS_VERIFY_CTX_free(x); }
  void operator()(TS_MSG_IMPRINT* x) const { TS_MSG_IMPRINT_free(x); }
  void operator()(X509_ALGOR* x) const { X509_ALGOR_free(x); }
  void operator()(ASN1_INTEGER* x) const { ASN1_INTEGER_free(x); }
};
template <class T>
using Owned = std::unique_ptr<T, Free>;

Owned<BIO> reading(const std::string& bytes) {
  return Owned<BIO>(BIO_new_mem_buf(bytes.data(), static_cast<int>(bytes.size())));
}

/// The first reason on OpenSSL's list is the cause; the later ones say where it was met.
std::string first_error() {
  const char *data = nullptr, *reason = nullptr;
  int flags = 0;
  const unsigned long code = ERR_peek_error_all(nullptr, nullptr, nullptr, &data, &flags);
  reason = code != 0 ? ERR_reason_error_string(code) : nullptr;
  std::string out = reason != nullptr ? reason : "unknown";
  if ((flags & ERR_TXT_STRING) != 0 && data != nullptr && *data != '\0') out += std::string(", ") + data;
  ERR_clear_error();
  return out;
}

/// A response that was granted, with its token; the fault otherwise.
Owned<TS_RESP> read_response(const std::string& der, std::string& fault) {
  Owned<TS_RESP> out(d2i_TS_RESP_bio(reading(der).get(), nullptr));
  if (!out) {
    ERR_clear_error();
    fault = "the time stamp cannot be read";
    return nullptr;
  }
  const TS_STATUS_INFO* status = TS_RESP_get_status_info(out.get());
  const long code = ASN1_INTEGER_get(TS_STATUS_INFO_get0_status(status));
  if (code != TS_STATUS_GRANTED && code != TS_STATUS_GRANTED_WITH_MODS) {
    fault = fmt::format("the time stamp was refused by its authority (status {})", code);
    return nullptr;
  }
  if (TS_RESP_get_tst_info(out.get()) == nullptr) {
    fault = "the time stamp holds no token";
    return nullptr;
  }
  return out;
}

bool has_strong_imprint(TS_TST_INFO* info) {
  const X509_ALGOR* algorithm = TS_MSG_IMPRINT_get_algo(TS_TST_INFO_get_msg_imprint(info));
  const ASN1_OBJECT* object = nullptr;
  X509_ALGOR_get0(&object, nullptr, nullptr, algorithm);
  const int id = OBJ_obj2nid(object);
  return id == NID_sha256 || id == NID_sha384 || id == NID_sha512;
}

std::string rfc3339(const std::tm& t) {
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z", t.tm_year + 1900, t.tm_mon + 1, t.tm_mday, t.tm_hour,
                     t.tm_min, t.tm_sec);
}

/// Certificates to trust at the token's time. None given: those of the token itself, each by itself.
X509_STORE* store_of(const std::vector<std::filesystem::path>& trusted, PKCS7* token, std::time_t time) {
  X509_STORE* store = X509_STORE_new();
  for (const auto& file : trusted) {
    for (const auto& one : certificates_of(file)) X509_STORE_add_cert(store, one.get());
  }
  X509_VERIFY_PARAM* parameters = X509_STORE_get0_param(store);
  X509_VERIFY_PARAM_set_time(parameters, time);
  if (trusted.empty()) {
    X509_VERIFY_PARAM_set_flags(parameters, X509_V_FLAG_PARTIAL_CHAIN);
    const STACK_OF(X509)* inside = token->d.sign->cert;
    for (int k = 0; k < sk_X509_num(inside); ++k) X509_STORE_add_cert(store, sk_X509_value(inside, k));
  }
  return store;
}

std::string signer_of(PKCS7* token) {
  std::string out;
  if (STACK_OF(X509)* signers = PKCS7_get0_signers(token, nullptr, 0)) {
    if (sk_X509_num(signers) > 0) out = subject_of(sk_X509_value(signers, 0));
    sk_X509_free(signers);
  }
  ERR_clear_error();
  return out.empty() ? "somebody" : out;
}

std::string der_of(const TS_REQ* request) {
  unsigned char* der = nullptr;
  const int size = i2d_TS_REQ(request, &der);
  require(size > 0, "a request for a time stamp can be written");
  std::string out(reinterpret_cast<const char*>(der), static_cast<std::size_t>(size));
  OPENSSL_free(der);
  return out;
}

}  // namespace

std::string time_stamp_request(const std::string& content) {
  std::array<unsigned char, SHA256_DIGEST_LENGTH> digest;
  SHA256(reinterpret_cast<const unsigned char*>(content.data()), content.size(), digest.data());
  const Owned<TS_MSG_IMPRINT> imprint(TS_MSG_IMPRINT_new());
  const Owned<X509_ALGOR> algorithm(X509_ALGOR_new());
  X509_ALGOR_set0(algorithm.get(), OBJ_nid2obj(NID_sha256), V_ASN1_NULL, nullptr);
  TS_MSG_IMPRINT_set_algo(imprint.get(), algorithm.get());
  TS_MSG_IMPRINT_set_msg(imprint.get(), digest.data(), static_cast<int>(digest.size()));
  std::uint64_t random = 0;
  require(RAND_bytes(reinterpret_cast<unsigned char*>(&random), sizeof random) == 1, "random numbers are there");
  const Owned<ASN1_INTEGER> nonce(ASN1_INTEGER_new());
  ASN1_INTEGER_set_uint64(nonce.get(), random | 1);  // never zero
  const Owned<TS_REQ> request(TS_REQ_new());
  TS_REQ_set_version(request.get(), 1);
  TS_REQ_set_msg_imprint(request.get(), imprint.get());
  TS_REQ_set_nonce(request.get(), nonce.get());
  TS_REQ_set_cert_req(request.get(), 1);
  return der_of(request.get());
}

std::string fault_of_answer(const std::string& request_der, const std::string& response_der) {
  const Owned<TS_REQ> request(d2i_TS_REQ_bio(reading(request_der).get(), nullptr));
  require(request != nullptr, "a request is one of time_stamp_request()");
  std::string fault;
  const auto response = read_response(response_der, fault);
  if (!response) return fault;
  // Version, policy, imprint and nonce of the request; who signed is judged by verify_time_stamp().
  const Owned<TS_VERIFY_CTX> context(TS_REQ_to_TS_VERIFY_CTX(request.get(), nullptr));
  TS_VERIFY_CTX_set_flags(context.get(), TS_VFY_VERSION | TS_VFY_IMPRINT | TS_VFY_NONCE);
  if (TS_RESP_verify_response(context.get(), response.get()) != 1) {
    return "the time stamp is not the answer to this question: " + first_error();
  }
  return "";
}

std::string time_stamp(const std::string& content, const std::string& url, const TimeStampLimits& limits) {
  const std::string request = time_stamp_request(content);
  std::string response = http_post({.url = url,
                                    .content_type = "application/timestamp-query",
                                    .accept = "application/timestamp-reply",
                                    .body = request,
                                    .together = limits.together,
                                    .largest_answer = limits.bytes});
  if (const std::string fault = fault_of_answer(request, response); !fault.empty()) {
    throw EnvironmentError(fmt::format("{}: {}", url, fault));
  }
  if (const auto verdict = verify_time_stamp(content, response, {}); !verdict.fault.empty()) {
    throw EnvironmentError(fmt::format("{}: {}", url, verdict.fault));
  }
  return response;
}

TimeStampVerdict verify_time_stamp(const std::string& content, const std::string& der,
                                   const std::vector<std::filesystem::path>& trusted) {
  TimeStampVerdict out;
  const auto response = read_response(der, out.fault);
  if (!response) return out;
  TS_TST_INFO* info = TS_RESP_get_tst_info(response.get());
  PKCS7* token = TS_RESP_get_token(response.get());
  std::tm when{};
  if (ASN1_TIME_to_tm(TS_TST_INFO_get_time(info), &when) != 1) {
    ERR_clear_error();
    out.fault = "the time of the time stamp cannot be read";
    return out;
  }
  out.time = rfc3339(when);
  out.authority = signer_of(token);
  if (!has_strong_imprint(info)) {
    out.fault = "the time stamp is over a hash that is too weak; SHA-256 or stronger is accepted";
    return out;
  }
  const Owned<TS_VERIFY_CTX> context(TS_VERIFY_CTX_new());
  TS_VERIFY_CTX_set_flags(context.get(), TS_VFY_VERSION | TS_VFY_DATA | TS_VFY_SIGNATURE);
  TS_VERIFY_CTX_set_data(context.get(), reading(content).release());                // owned by the context
  TS_VERIFY_CTX_set_store(context.get(), store_of(trusted, token, timegm(&when)));  // likewise
  if (TS_RESP_verify_response(context.get(), response.get()) != 1) {
    out.fault = fmt::format("the time stamp does not hold ({})", first_error());
  }
  return out;
}

}  // namespace fringecal::reports
