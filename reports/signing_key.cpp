#include "reports/signing_key.h"

#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/pkcs12.h>
#include <openssl/x509.h>
#include <sys/stat.h>

#include <algorithm>

namespace fringecal::reports {
namespace {

struct FreeBio {
  void operator()(BIO* bio) const { BIO_free_all(bio); }
};
using Bio = std::unique_ptr<BIO, FreeBio>;

Bio reading(const std::string& bytes) { return Bio(BIO_new_mem_buf(bytes.data(), static_cast<int>(bytes.size()))); }

std::string text_in(BIO* bio) {
  char* data = nullptr;
  const long size = BIO_get_mem_data(bio, &data);
  return {data, static_cast<std::size_t>(size)};
}

struct Passphrase {
  const std::function<std::string()>& ask;
  bool asked = false;
  static int call(char* buffer, int size, int, void* self) {
    auto& me = *static_cast<Passphrase*>(self);
    me.asked = true;
    const std::string words = me.ask();
    if (words.size() > static_cast<std::size_t>(size)) return -1;
    std::copy(words.begin(), words.end(), buffer);  // by its length: no zero at the end
    return static_cast<int>(words.size());
  }
};

void refuse_readable_by_others(const std::filesystem::path& file) {
  struct ::stat status {};
  if (::stat(file.c_str(), &status) == 0 && (status.st_mode & 077) != 0) {
    throw InputError(fmt::format("{}: others may read this private key (mode {:04o}); run chmod 600 {}", file.string(),
                                 status.st_mode & 07777, file.string()));
  }
}

std::vector<CertificateHandle> certificates_in(const std::string& pem) {
  std::vector<CertificateHandle> out;
  const Bio bio = reading(pem);
  while (X509* one = PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr)) out.emplace_back(one);
  ERR_clear_error();
  return out;
}

void read_pkcs12(const std::string& bytes, const std::string& name, const std::function<std::string()>& ask,
                 SigningKey::State& out) {
  const Bio bio = reading(bytes);
  const std::unique_ptr<PKCS12, decltype(&PKCS12_free)> p12(d2i_PKCS12_bio(bio.get(), nullptr), &PKCS12_free);
  if (!p12) throw InputError(fmt::format("{}: neither a PEM nor a PKCS#12 key", name));
  const bool open = PKCS12_verify_mac(p12.get(), "", 0) == 1 || PKCS12_verify_mac(p12.get(), nullptr, 0) == 1;
  const std::string words = open ? "" : ask();
  EVP_PKEY* key = nullptr;
  X509* certificate = nullptr;
  STACK_OF(X509)* others = nullptr;
  if (PKCS12_parse(p12.get(), words.c_str(), &key, &certificate, &others) != 1) {
    ERR_clear_error();
    throw InputError(
        fmt::format("{}: cannot be opened; the passphrase is wrong, or the file uses RC2 (export it again "
                    "with openssl pkcs12 -export)",
                    name));
  }
  out.key.reset(key);
  if (certificate != nullptr) out.certificates.emplace_back(certificate);
  for (int k = 0; k < sk_X509_num(others); ++k) out.certificates.emplace_back(sk_X509_value(others, k));
  sk_X509_free(others);
}

}  // namespace

void FreeKey::operator()(evp_pkey_st* key) const { EVP_PKEY_free(key); }
void FreeCertificate::operator()(x509_st* certificate) const { X509_free(certificate); }

SigningKey::SigningKey(std::unique_ptr<State> state) : state_(std::move(state)) {}
SigningKey::~SigningKey() = default;
SigningKey::SigningKey(SigningKey&&) noexcept = default;

SigningKey SigningKey::load(const std::filesystem::path& file, const std::optional<std::filesystem::path>& certificate,
                            const std::function<std::string()>& ask) {
  const std::string bytes = read_bytes(file), name = file.string();
  refuse_readable_by_others(file);
  auto state = std::make_unique<State>();
  if (bytes.find("-----BEGIN ") != std::string::npos) {
    const Bio bio = reading(bytes);
    Passphrase passphrase{ask};
    state->key.reset(PEM_read_bio_PrivateKey(bio.get(), nullptr, &Passphrase::call, &passphrase));
    ERR_clear_error();
    if (!state->key) {
      throw InputError(fmt::format(
          "{}: {}", name,
          passphrase.asked ? "the passphrase does not open this key" : "there is no private key in this file"));
    }
    state->certificates = certificates_in(bytes);
  } else {
    read_pkcs12(bytes, name, ask, *state);
  }
  if (certificate) state->certificates = certificates_of(*certificate);
  const auto own =
      std::find_if(state->certificates.begin(), state->certificates.end(),
                   [&](const CertificateHandle& c) { return X509_check_private_key(c.get(), state->key.get()) == 1; });
  ERR_clear_error();
  if (own == state->certificates.end()) {
    throw InputError(
        fmt::format("{}: there is no certificate that belongs to this key; give it with --certificate", name));
  }
  std::rotate(state->certificates.begin(), own, own + 1);
  const int kind = EVP_PKEY_base_id(state->key.get()), bits = EVP_PKEY_bits(state->key.get());
  state->is_ec = kind == EVP_PKEY_EC;
  if (kind != EVP_PKEY_EC && kind != EVP_PKEY_RSA)
    throw InputError(fmt::format("{}: neither an RSA nor an EC key", name));
  if (kind == EVP_PKEY_RSA && bits < 2048)
    throw InputError(fmt::format("{}: RSA with {} bit; at least 2048", name, bits));
  if (kind == EVP_PKEY_EC && bits < 256) throw InputError(fmt::format("{}: EC with {} bit; at least 256", name, bits));
  return SigningKey(std::move(state));
}

std::string SigningKey::subject() const { return subject_of(state_->certificates.front().get()); }

bool SigningKey::is_test() const {
  std::string name = subject();
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::toupper(c); });
  return name.find("TEST") != std::string::npos;
}

std::string subject_of(x509_st* certificate) {
  const Bio bio(BIO_new(BIO_s_mem()));
  X509_NAME_print_ex(bio.get(), X509_get_subject_name(certificate), 0, XN_FLAG_RFC2253 & ~ASN1_STRFLGS_ESC_MSB);
  return text_in(bio.get());
}

std::vector<CertificateHandle> certificates_of(const std::filesystem::path& file) {
  auto out = certificates_in(read_bytes(file));
  if (out.empty()) throw InputError(fmt::format("{}: there is no certificate in PEM form in this file", file.string()));
  return out;
}

std::string pem_of(x509_st* certificate) {
  const Bio bio(BIO_new(BIO_s_mem()));
  PEM_write_bio_X509(bio.get(), certificate);
  return text_in(bio.get());
}

}  // namespace fringecal::reports
