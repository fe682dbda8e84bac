// The laboratory's signature: XMLDSig, enveloped, on the XML; CMS (RFC 5652), detached, on the PDF.
//
// What is signed: the whole XML document but its own Signature (one Reference with URI "", enveloped-signature and
// Canonical XML 1.1, SHA-256); RSA PKCS#1 v1.5 or ECDSA, with SHA-256; the certificates go along in X509Data. The CMS
// signature is over the PDF's bytes, without signed attributes, so that no clock is read.
// ECDSA takes its nonce from key and message [RFC 6979], so the same key and content give the same bytes.
//
// Verification accepts nothing else: no reference to a part or to a file, no transform but those two (and exclusive and 1.0
// canonical XML), no SHA-1, no key without a certificate. Every Signature in the document must hold.
//
// Key files: PEM (key and certificates in one file, or the certificates in another) or PKCS#12. A key that others may read
// is refused. RSA below 2048 bit is refused. All functions throw InputError with the file and what is wrong; a message
// never holds a passphrase.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::reports {

class SigningKey {
 public:
  /// passphrase is asked for only when the file is encrypted. certificate: a PEM file, when they are not in `key`.
  static SigningKey load(const std::filesystem::path& key, const std::optional<std::filesystem::path>& certificate,
                         const std::function<std::string()>& passphrase);
  ~SigningKey();
  SigningKey(SigningKey&&) noexcept;

  std::string subject() const;  // RFC 2253, UTF-8
  bool is_test() const;         // the subject's name holds the word TEST

  struct State;
  const State& state() const { return *state_; }

 private:
  explicit SigningKey(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// The document with a Signature as the last child of its root.
std::string sign_xml(const std::string& xml, const SigningKey& key);
/// DER.
std::string sign_detached(const std::string& content, const SigningKey& key);

struct SignatureVerdict {
  bool present = false;
  std::string fault;    // empty: intact, and traced to a trusted certificate where any were given
  std::string subject;  // of the signer's certificate, as far as it could be read
};

/// trusted: PEM files of certificates; empty: integrity is judged, not who signed.
SignatureVerdict verify_xml(const std::string& xml, const std::vector<std::filesystem::path>& trusted);
SignatureVerdict verify_detached(const std::string& content, const std::string& signature,
                                 const std::vector<std::filesystem::path>& trusted);

}  // namespace fringecal::reports
