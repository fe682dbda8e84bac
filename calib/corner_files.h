// Corners that another program found, as views for the camera's solve.
//
// Two forms of text:
//   .vnl (mrcal, mrgingham): a legend "# filename x y level" (or "weight"), then a line per corner, the board's corners of
//   an image row after row; "-" instead of a number: not seen. Every image has all columns x rows lines, or a single
//   line of "-" where no board was found. The column after y is not used: every corner gets the same weight.
//   numbers: x y x y ..., white space between, the corners of one view in the order of the board; "#" begins a comment.
//   One file per view.                                                                                         [mrcal]
// Frame board: (column pitch_x, row pitch_y), or the places of a file of numbers (x y x y ..) times a length. px, mm.
// Errors: InputError with file and line.
#pragma once

#include "calib/camera_solve.h"
#include "calib/model/board.h"

#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace fringecal::calib {

struct NamedView {
  std::string name;  // of the image or file
  PlanarView view;
};

/// The places of a board's corners, row after row.
std::vector<Eigen::Vector2d> places_of(const model::Board& board);
/// Places from a file of numbers, each times `unit_mm`.
std::vector<Eigen::Vector2d> read_places(const std::filesystem::path& file, double unit_mm);

/// Views with at least four corners; those without a board are left out.
std::vector<NamedView> read_corners(std::span<const std::filesystem::path> files,
                                    std::span<const Eigen::Vector2d> places_mm);

}  // namespace fringecal::calib
