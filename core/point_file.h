// Point files: .xyz (x y z per line, white space or comma), .ds (NIST: first line the count), .ply (ASCII or binary).
#pragma once

#include <Eigen/Core>

#include <filesystem>
#include <vector>

namespace fringecal {

enum class LengthUnit { mm, m };

/// Points in mm. Throws InputError: missing or unreadable file, no points, a line that is not three numbers (with its
/// line number), NaN or infinity, a count that does not match, a truncated binary body.
std::vector<Eigen::Vector3d> read_points_mm(const std::filesystem::path& file, LengthUnit unit = LengthUnit::mm);

}  // namespace fringecal
