// A ZIP archive in memory [APPNOTE 6.3], made by libzip. The same files and date give the same bytes on one version of
// libzip and zlib: the entries stand in the order given, deflated, all with the one date.
#pragma once

#include <string>
#include <vector>

namespace fringecal::reports {

struct ArchiveFile {
  std::string name;  // with folders: "clouds/ball_bar-03-1.ply"
  std::string bytes;
};

/// date: RFC 3339 UTC; ZIP counts from 1980 in steps of 2 s, earlier dates become 1980-01-01. Names must differ.
std::string zip_archive(const std::vector<ArchiveFile>& files, const std::string& date);

}  // namespace fringecal::reports
