// Whether a sanitizer is compiled in: the time that the program then takes is not its own.
#pragma once

#ifndef __has_feature  // clang's
#define __has_feature(name) 0
#endif

namespace fringecal::test {

#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__) || __has_feature(address_sanitizer)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

}  // namespace fringecal::test
