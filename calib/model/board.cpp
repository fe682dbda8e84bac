#include "calib/model/board.h"

#include <fmt/format.h>

namespace fringecal::model {
namespace {

constexpr const char* kKinds[] = {"chessboard", "circles", "asymmetric_circles"};

}  // namespace

Eigen::Vector3d Board::corner_mm(int column, int row) const {
  const double shift = kind == BoardKind::asymmetric_circles && row % 2 == 1 ? 0.5 : 0.0;
  return {(column + shift) * pitch_x_mm, row * pitch_y_mm, 0.0};
}

Board board_from(Fields fields) {
  Board b;
  const std::string kind = fields.text("kind");
  if (kind == kKinds[0]) {
    b.kind = BoardKind::chessboard;
  } else if (kind == kKinds[1]) {
    b.kind = BoardKind::circles;
  } else if (kind == kKinds[2]) {
    b.kind = BoardKind::asymmetric_circles;
  } else {
    fields.complain(fmt::format("kind is '{}'; it is \"chessboard\", \"circles\" or \"asymmetric_circles\"", kind));
  }
  b.columns = fields.integer("columns");
  b.rows = fields.integer("rows");
  if (fields.has("pitch_mm")) {
    b.pitch_x_mm = b.pitch_y_mm = fields.number("pitch_mm");
  } else {
    b.pitch_x_mm = fields.number("pitch_x_mm");
    b.pitch_y_mm = fields.number("pitch_y_mm");
  }
  // Office-printer and photo-plate boards lie around these figures; a certificate replaces them.
  b.u_print_mm = fields.optional_number("u_print_mm").value_or(0.010);
  b.u_pitch_relative = fields.optional_number("u_pitch_relative").value_or(1e-4);
  b.certificate = fields.optional_text("certificate").value_or("");
  fields.finish();
  if (b.columns < 3 || b.rows < 3) {
    fields.complain(fmt::format("the board has {} x {} corners; at least 3 x 3 are needed", b.columns, b.rows));
  }
  if (!(b.pitch_x_mm > 0 && b.pitch_y_mm > 0)) fields.complain("the pitch must be positive");
  if (!(b.u_print_mm >= 0 && b.u_pitch_relative >= 0)) fields.complain("an uncertainty is not negative");
  return b;
}

Board read_board(const std::filesystem::path& file) { return board_from(Fields(read_toml(file), file.string())); }

Value to_value(const Board& b) {
  return Value::object()
      .set("kind", kKinds[static_cast<int>(b.kind)])
      .set("columns", b.columns)
      .set("rows", b.rows)
      .set("pitch_x_mm", b.pitch_x_mm)
      .set("pitch_y_mm", b.pitch_y_mm)
      .set("u_print_mm", b.u_print_mm)
      .set("u_pitch_relative", b.u_pitch_relative)
      .set("certificate", b.certificate);
}

}  // namespace fringecal::model
