// The calibration board: a plane with a regular pattern, and what is known of its making.
//
// Frame `board`: corner (column i, row j) stands at (i pitch_x, j pitch_y, 0) mm, i = 0 .. columns-1, j = 0 .. rows-1.
// Chessboard: the *inner* corners. Circle grids: the centres; in an asymmetric grid odd rows stand half a pitch to the
// right: (i + (j mod 2)/2) pitch_x, and pitch_y is the distance of neighbouring rows.
#pragma once

#include "core/fields.h"

#include <Eigen/Core>

#include <filesystem>
#include <string>

namespace fringecal::model {

enum class BoardKind { chessboard, circles, asymmetric_circles };

struct Board {
  BoardKind kind = BoardKind::chessboard;
  int columns = 0, rows = 0;
  double pitch_x_mm = 0, pitch_y_mm = 0;
  double u_print_mm = 0;        // standard uncertainty of one corner's place on the board (x and y each, independent)
  double u_pitch_relative = 0;  // standard uncertainty of the scale: u(pitch) / pitch
  std::string certificate;      // number, laboratory, date; free text, empty where there is none

  int corners() const { return columns * rows; }
  Eigen::Vector3d corner_mm(int column, int row) const;
};

/// board.toml: kind = "chessboard" | "circles" | "asymmetric_circles"; columns; rows; pitch_mm (both) or pitch_x_mm and
/// pitch_y_mm; optional u_print_mm (default 0.010), u_pitch_relative (default 1e-4), certificate. InputError otherwise.
Board read_board(const std::filesystem::path& file);
Board board_from(Fields fields);
Value to_value(const Board& board);

}  // namespace fringecal::model
