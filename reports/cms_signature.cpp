// The detached signature of the PDF.
#include "reports/signing_key.h"

#include "core/error.h"

#include <openssl/asn1.h>
#include <openssl/bio.h>
#include <openssl/cms.h>
#include <openssl/err.h>
#include <openssl/x509_vfy.h>

#include <memory>

namespace fringecal::reports {
namespace {

struct Free {
  void operator()(BIO* x) const { BIO_free_all(x); }
  void operator()(CMS_ContentInfo* x) const { CMS_ContentInfo_free(x); }
  void operator()(X509_STORE* x) const { X509_STORE_free(x); }
};
using Bio = std::unique_ptr<BIO, Free>;
using Message = std::unique_ptr<CMS_ContentInfo, Free>;
constexpr unsigned kFlags = CMS_DETACHED | CMS_BINARY;

Bio reading(const std::string& bytes) { return Bio(BIO_new_mem_buf(bytes.data(), static_cast<int>(bytes.size()))); }

std::string last_error() {
  const char* reason = ERR_reason_error_string(ERR_peek_last_error());
  std::string out = reason != nullptr ? reason : "unknown";
  ERR_clear_error();
  return out;
}

}  // namespace

std::string sign_detached(const std::string& content, const SigningKey& key) {
  const auto& state = key.state();
  const Message message(CMS_sign(nullptr, nullptr, nullptr, nullptr, kFlags | CMS_PARTIAL));
  CMS_SignerInfo* signer = message == nullptr
                               ? nullptr
                               : CMS_add1_signer(message.get(), state.certificates.front().get(), state.key.get(),
                                                 EVP_sha256(), kFlags | CMS_PARTIAL | CMS_NOATTR);
  if (signer == nullptr) throw InputError("the key cannot sign the PDF: " + last_error());
  for (std::size_t k = 1; k < state.certificates.size(); ++k) CMS_add1_cert(message.get(), state.certificates[k].get());
  if (CMS_final(message.get(), reading(content).get(), nullptr, kFlags) != 1) {
    throw InputError("the key cannot sign the PDF: " + last_error());
  }
  if (state.is_ec) {
    const std::string signature = ecdsa_der(ecdsa_sha256(state, content));
    ASN1_STRING_set(CMS_SignerInfo_get0_signature(signer), signature.data(), static_cast<int>(signature.size()));
  }
  unsigned char* der = nullptr;
  const int size = i2d_CMS_ContentInfo(message.get(), &der);
  require(size > 0, "a CMS message can be written");
  std::string out(reinterpret_cast<const char*>(der), static_cast<std::size_t>(size));
  OPENSSL_free(der);
  return out;
}

SignatureVerdict verify_detached(const std::string& content, const std::string& signature,
                                 const std::vector<std::filesystem::path>& trusted) {
  SignatureVerdict out;
  const Message message(d2i_CMS_bio(reading(signature).get(), nullptr));
  if (!message) {
    ERR_clear_error();
    out.fault = "the signature of the PDF cannot be read as CMS";
    return out;
  }
  out.present = true;
  const std::unique_ptr<X509_STORE, Free> store(X509_STORE_new());
  X509_STORE_set_purpose(store.get(), X509_PURPOSE_ANY);
  for (const auto& file : trusted) {
    for (const auto& one : certificates_of(file)) X509_STORE_add_cert(store.get(), one.get());
  }
  const unsigned flags = kFlags | (trusted.empty() ? CMS_NO_SIGNER_CERT_VERIFY : 0u);
  if (CMS_verify(message.get(), nullptr, store.get(), reading(content).get(), nullptr, flags) != 1) {
    out.fault = "the signature of the PDF does not hold (" + last_error() + ")";
  }
  if (STACK_OF(X509)* signers = CMS_get0_signers(message.get())) {
    if (sk_X509_num(signers) > 0) out.subject = subject_of(sk_X509_value(signers, 0));
    sk_X509_free(signers);
  }
  return out;
}

}  // namespace fringecal::reports
