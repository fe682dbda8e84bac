// OpenSSL's side of a signing key; for signing_key.cpp, xml_signature.cpp, cms_signature.cpp and time_stamp.cpp only.
#pragma once

#include "reports/signature.h"

#include <memory>
#include <string>
#include <vector>

// OpenSSL's own types, declared here so that its headers stay in the source files.
struct evp_pkey_st;
struct x509_st;

namespace fringecal::reports {

struct FreeKey {
  void operator()(evp_pkey_st* key) const;
};
struct FreeCertificate {
  void operator()(x509_st* certificate) const;
};
using KeyHandle = std::unique_ptr<evp_pkey_st, FreeKey>;
using CertificateHandle = std::unique_ptr<x509_st, FreeCertificate>;

struct SigningKey::State {
  KeyHandle key;
  std::vector<CertificateHandle> certificates;  // the signer's first
  bool is_ec = false;
};

std::string subject_of(x509_st* certificate);
/// All certificates of a PEM file. Throws InputError where there is none.
std::vector<CertificateHandle> certificates_of(const std::filesystem::path& file);
std::string pem_of(x509_st* certificate);

/// ECDSA with SHA-256 and the nonce of RFC 6979: r and s, big-endian, each as long as the curve's order.
std::string ecdsa_sha256(const SigningKey::State& key, const std::string& message);
/// The same as the DER SEQUENCE that CMS wants.
std::string ecdsa_der(const std::string& r_and_s);

}  // namespace fringecal::reports
