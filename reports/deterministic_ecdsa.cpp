// ECDSA with the nonce of RFC 6979, section 3.2. OpenSSL 3.0 draws its nonces at random and has no switch for it; its
// ECDSA_do_sign_ex takes k^-1 and r from the caller, which is all that is needed.
#define OPENSSL_API_COMPAT \
  0x10100000L  // the EC_KEY functions are deprecated in 3.0, and their successors take no nonce
#include "reports/signing_key.h"

#include "core/error.h"

#include <openssl/bn.h>
#include <openssl/ec.h>
#include <openssl/ecdsa.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/sha.h>

#include <memory>

namespace fringecal::reports {
namespace {

template <class T, void (*Free)(T*)>
struct Freed {
  void operator()(T* x) const { Free(x); }
};
using Number = std::unique_ptr<BIGNUM, Freed<BIGNUM, BN_clear_free>>;
using Context = std::unique_ptr<BN_CTX, Freed<BN_CTX, BN_CTX_free>>;
using Point = std::unique_ptr<EC_POINT, Freed<EC_POINT, EC_POINT_free>>;
using Signature = std::unique_ptr<ECDSA_SIG, Freed<ECDSA_SIG, ECDSA_SIG_free>>;

std::string sha256(const std::string& message) {
  std::string out(SHA256_DIGEST_LENGTH, '\0');
  SHA256(reinterpret_cast<const unsigned char*>(message.data()), message.size(),
         reinterpret_cast<unsigned char*>(out.data()));
  return out;
}

std::string hmac(const std::string& key, const std::string& message) {
  std::string out(SHA256_DIGEST_LENGTH, '\0');
  HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()), reinterpret_cast<const unsigned char*>(message.data()),
       message.size(), reinterpret_cast<unsigned char*>(out.data()), nullptr);
  return out;
}

Number number_from(const std::string& bytes) {
  return Number(
      BN_bin2bn(reinterpret_cast<const unsigned char*>(bytes.data()), static_cast<int>(bytes.size()), nullptr));
}

std::string octets(const BIGNUM* number, std::size_t length) {
  std::string out(length, '\0');
  require(BN_bn2binpad(number, reinterpret_cast<unsigned char*>(out.data()), static_cast<int>(length)) >= 0,
          "a number below the curve's order has its length");
  return out;
}

/// bits2int of RFC 6979, 2.3.2: the leftmost qlen bits.
Number bits_to_number(const std::string& bits, int order_bits) {
  Number out = number_from(bits);
  const int excess = static_cast<int>(bits.size()) * 8 - order_bits;
  if (excess > 0) BN_rshift(out.get(), out.get(), excess);
  return out;
}

/// The candidates k of RFC 6979, 3.2, steps b to h.
class Nonces {
 public:
  Nonces(const BIGNUM* order, const BIGNUM* secret, const std::string& digest)
      : bits_(BN_num_bits(order)), length_((static_cast<std::size_t>(bits_) + 7) / 8), v_(32, '\1'), k_(32, '\0') {
    Number h = bits_to_number(digest, bits_);
    if (BN_cmp(h.get(), order) >= 0) BN_sub(h.get(), h.get(), order);  // bits2octets
    const std::string seed = octets(secret, length_) + octets(h.get(), length_);
    for (const char step : {'\0', '\1'}) {
      k_ = hmac(k_, v_ + step + seed);
      v_ = hmac(k_, v_);
    }
  }
  Number next() {
    if (started_) {
      k_ = hmac(k_, v_ + '\0');
      v_ = hmac(k_, v_);
    }
    started_ = true;
    std::string bytes;
    while (bytes.size() < length_) bytes += v_ = hmac(k_, v_);
    return bits_to_number(bytes.substr(0, length_), bits_);
  }

 private:
  int bits_;
  std::size_t length_;
  std::string v_, k_;
  bool started_ = false;
};

}  // namespace

std::string ecdsa_sha256(const SigningKey::State& key, const std::string& message) {
  const EC_KEY* ec = EVP_PKEY_get0_EC_KEY(key.key.get());
  require(ec != nullptr, "an EC key signs with ECDSA");
  const EC_GROUP* group = EC_KEY_get0_group(ec);
  const BIGNUM* order = EC_GROUP_get0_order(group);
  const auto length = static_cast<std::size_t>(BN_num_bytes(order));
  const std::string digest = sha256(message);
  const Context context(BN_CTX_new());
  Nonces nonces(order, EC_KEY_get0_private_key(ec), digest);
  for (;;) {
    Number k = nonces.next();
    if (BN_is_zero(k.get()) || BN_cmp(k.get(), order) >= 0) continue;
    BN_set_flags(k.get(), BN_FLG_CONSTTIME);
    const Point point(EC_POINT_new(group));
    const Number x(BN_new()), r(BN_new()), inverse(BN_new());
    EC_POINT_mul(group, point.get(), k.get(), nullptr, nullptr, context.get());
    EC_POINT_get_affine_coordinates(group, point.get(), x.get(), nullptr, context.get());
    BN_nnmod(r.get(), x.get(), order, context.get());
    if (BN_is_zero(r.get())) continue;
    BN_mod_inverse(inverse.get(), k.get(), order, context.get());
    const Signature signature(ECDSA_do_sign_ex(reinterpret_cast<const unsigned char*>(digest.data()),
                                               static_cast<int>(digest.size()), inverse.get(), r.get(),
                                               const_cast<EC_KEY*>(ec)));
    require(signature != nullptr, "ECDSA signs a digest");
    return octets(ECDSA_SIG_get0_r(signature.get()), length) + octets(ECDSA_SIG_get0_s(signature.get()), length);
  }
}

std::string ecdsa_der(const std::string& r_and_s) {
  const std::size_t half = r_and_s.size() / 2;
  const Signature signature(ECDSA_SIG_new());
  ECDSA_SIG_set0(signature.get(), number_from(r_and_s.substr(0, half)).release(),
                 number_from(r_and_s.substr(half)).release());
  unsigned char* der = nullptr;
  const int size = i2d_ECDSA_SIG(signature.get(), &der);
  std::string out(reinterpret_cast<const char*>(der), static_cast<std::size_t>(size));
  OPENSSL_free(der);
  return out;
}

}  // namespace fringecal::reports
