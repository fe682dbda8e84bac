// Time stamps [RFC 3161] on the files of a certificate: an authority signs their SHA-256 with the time, so that whoever
// checks knows that they were there by then, whatever becomes of the laboratory's key. Detached: FILE.tsr is the
// authority's TimeStampResp in DER, as `openssl ts` reads it.
//
// Verified: the token's version, its imprint of the content (SHA-256, 384 or 512), the authority's signature with ESS
// signing certificate, the extended key usage timeStamping (alone and critical), and the chain to a trusted certificate,
// valid *at the token's time*: a stamp outlives the certificate of its authority. Revocation is not looked up: nothing is
// loaded when a certificate is checked.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

namespace fringecal::reports {

struct TimeStampLimits {
  std::chrono::seconds together{20};  // from the look-up of the name to the last byte
  std::size_t bytes = 200'000;        // of the answer; a token with its chain has about 6000
};

/// Asks the server for a stamp and verifies that the answer is to this question (status, imprint, nonce). http or https;
/// no redirect is followed. Throws EnvironmentError with the address and why there is no stamp; InputError where the
/// address is none.
std::string time_stamp(const std::string& content, const std::string& url, const TimeStampLimits& limits = {});

struct TimeStampVerdict {
  std::string fault;  // empty: holds
  std::string time;   // RFC 3339 UTC
  std::string authority;
};

/// trusted: PEM files of certificates; empty: integrity is judged, not who stamped.
TimeStampVerdict verify_time_stamp(const std::string& content, const std::string& response,
                                   const std::vector<std::filesystem::path>& trusted);

/// DER TimeStampReq with SHA-256, a nonce of 64 bits, and the wish for certificates.
std::string time_stamp_request(const std::string& content);
/// Why this answer is not one to this request; "" where it is.
std::string fault_of_answer(const std::string& request, const std::string& response);

}  // namespace fringecal::reports
