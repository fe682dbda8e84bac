#include "reports/archive.h"

#include "core/error.h"

#include <fmt/format.h>
#include <zip.h>

#include <algorithm>
#include <cstdlib>
#include <memory>

namespace fringecal::reports {
namespace {

struct Discard {
  void operator()(zip_t* archive) const { zip_discard(archive); }
  void operator()(zip_source_t* source) const { zip_source_free(source); }
};
using Archive = std::unique_ptr<zip_t, Discard>;
using Source = std::unique_ptr<zip_source_t, Discard>;
constexpr zip_uint32_t kLevel = 6;  // residual clouds hardly shrink further at 9, in three times the time

struct DosTime {
  zip_uint16_t time = 0, date = (1 << 5) | 1;  // 1980-01-01
};

DosTime dos_time(const std::string& rfc3339) {
  require(rfc3339.size() >= 19, "a date is RFC 3339");
  const auto number = [&](std::size_t at, std::size_t n) { return std::atoi(rfc3339.substr(at, n).c_str()); };
  if (number(0, 4) < 1980) return {};
  return {static_cast<zip_uint16_t>(number(11, 2) << 11 | number(14, 2) << 5 | number(17, 2) / 2),
          static_cast<zip_uint16_t>((number(0, 4) - 1980) << 9 | number(5, 2) << 5 | number(8, 2))};
}

}  // namespace

std::string zip_archive(const std::vector<ArchiveFile>& files, const std::string& date) {
  zip_error_t error;
  zip_error_init(&error);
  Source memory(zip_source_buffer_create(nullptr, 0, 0, &error));
  require(memory != nullptr, "memory for an archive");
  Archive archive(zip_open_from_source(memory.get(), ZIP_CREATE | ZIP_TRUNCATE, &error));
  require(archive != nullptr, "an archive can be begun in memory");
  zip_source_keep(memory.get());  // the archive frees it once, `memory` once
  const DosTime when = dos_time(date);
  for (const auto& file : files) {
    zip_source_t* bytes = zip_source_buffer(archive.get(), file.bytes.data(), file.bytes.size(), 0);
    const zip_int64_t index = zip_file_add(archive.get(), file.name.c_str(), bytes, ZIP_FL_ENC_UTF_8);
    require(index >= 0, "the names of an archive's files differ");
    const auto i = static_cast<zip_uint64_t>(index);
    zip_set_file_compression(archive.get(), i, ZIP_CM_DEFLATE, kLevel);
    zip_file_set_dostime(archive.get(), i, when.time, when.date, 0);
  }
  if (zip_close(archive.get()) != 0) {
    throw EnvironmentError(fmt::format("data.zip cannot be packed: {}", zip_strerror(archive.get())));
  }
  (void)archive.release();  // closed
  zip_stat_t status;
  require(zip_source_stat(memory.get(), &status) == 0 && zip_source_open(memory.get()) == 0,
          "a packed archive is read");
  std::string out(status.size, '\0');
  require(zip_source_read(memory.get(), out.data(), out.size()) == static_cast<zip_int64_t>(out.size()),
          "a packed archive is read whole");
  zip_source_close(memory.get());
  return out;
}

}  // namespace fringecal::reports
