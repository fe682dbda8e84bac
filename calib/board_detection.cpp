#include "calib/board_detection.h"

#include "calib/board_corners.h"
#include "core/error.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>

#include <cmath>

namespace fringecal::calib {
namespace {

using Places = std::vector<Eigen::Vector2d>;

Image<float> to_float(const GrayImage& image) {
  return std::visit(
      [](const auto& i) {
        Image<float> out(i.width(), i.height());
        for (std::size_t k = 0; k < i.size(); ++k) out.values()[k] = static_cast<float>(i.values()[k]);
        return out;
      },
      image);
}

/// The grid with its columns, rows or both counted from the other end.
Places turned(const Places& places, const model::Board& board, bool columns, bool rows) {
  Places out;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      const int c = columns ? board.columns - 1 - column : column, r = rows ? board.rows - 1 - row : row;
      out.push_back(places[static_cast<std::size_t>(r * board.columns + c)]);
    }
  }
  return out;
}

/// A quarter turn; the board has as many columns as rows.
Places quarter_turned(const Places& places, const model::Board& board) {
  Places out;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      out.push_back(places[static_cast<std::size_t>((board.rows - 1 - column) * board.columns + row)]);
    }
  }
  return out;
}

Eigen::Vector2d column_direction(const Places& p, const model::Board& b) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (int row = 0; row < b.rows; ++row) {
    sum += p[static_cast<std::size_t>((row + 1) * b.columns - 1)] - p[static_cast<std::size_t>(row * b.columns)];
  }
  return sum.normalized();
}

Eigen::Vector2d row_direction(const Places& p, const model::Board& b) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  // Rows of an asymmetric grid are shifted: every second one is compared.
  const int last = (b.rows - 1) / 2 * 2;
  for (int column = 0; column < b.columns; ++column) {
    sum += p[static_cast<std::size_t>(last * b.columns + column)] - p[static_cast<std::size_t>(column)];
  }
  return sum.normalized();
}

/// Mean grey value of the squares of the colour of square (0, 0) minus that of the others.
double first_colour(const Image<float>& image, const Places& p, const model::Board& b) {
  double sum[2] = {0, 0};
  int count[2] = {0, 0};
  for (int row = 0; row + 1 < b.rows; ++row) {
    for (int column = 0; column + 1 < b.columns; ++column) {
      const auto k = static_cast<std::size_t>(row * b.columns + column),
                 below = k + static_cast<std::size_t>(b.columns);
      const Eigen::Vector2d middle = 0.25 * (p[k] + p[k + 1] + p[below] + p[below + 1]);
      const int x = static_cast<int>(std::lround(middle.x())), y = static_cast<int>(std::lround(middle.y()));
      if (!image.contains(x, y)) continue;
      sum[(row + column) % 2] += image(x, y);
      ++count[(row + column) % 2];
    }
  }
  return count[0] > 0 && count[1] > 0 ? sum[0] / count[0] - sum[1] / count[1] : 0.0;
}

/// The order of the header: not mirrored; where the colours tell the two ends of the board apart, square (0, 0) dark;
/// else columns with the image's x.
Places ordered(Places p, const Image<float>& image, const model::Board& board) {
  const auto cross = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); };
  const bool chessboard = board.kind == model::BoardKind::chessboard;
  const bool asymmetric = board.kind == model::BoardKind::asymmetric_circles;
  if (cross(column_direction(p, board), row_direction(p, board)) < 0) {
    // An asymmetric grid with an odd number of rows keeps its pattern when the rows are counted from the other end;
    // with columns it never does.
    p = turned(p, board, !asymmetric, asymmetric);
  }
  // A half turn maps an asymmetric grid onto itself only with an even number of rows.
  if (asymmetric && board.rows % 2 == 1) return p;
  if (chessboard && (board.columns + board.rows) % 2 == 1) {
    return first_colour(image, p, board) > 0 ? turned(p, board, true, true) : p;
  }
  if (!asymmetric && board.columns == board.rows) {
    Places best = p;
    for (int quarter = 0; quarter < 3; ++quarter) {
      p = quarter_turned(p, board);
      if (column_direction(p, board).x() > column_direction(best, board).x()) best = p;
    }
    return best;
  }
  return column_direction(p, board).x() < 0 ? turned(p, board, true, true) : p;
}

/// Standard deviation of a corner's coordinates from the smoothness of the grid: the pixel as a function of the place
/// (x, y) on the board is a homography bent by the lens, here (cubic in x, y) / (1 + c x + d y), whose residual scatter
/// is that of the corners. Detection and printing errors together.
double grid_scatter_px(const Places& places, const model::Board& board) {
  constexpr int kTerms = 10;  // cubic in two variables
  const auto n = static_cast<Eigen::Index>(places.size());
  Eigen::MatrixXd a(n, kTerms);
  Eigen::MatrixXd b(n, 2);
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      const Eigen::Index k = row * board.columns + column;
      const Eigen::Vector3d last = board.corner_mm(board.columns - 1, board.rows - 1), p = board.corner_mm(column, row);
      const double x = 2.0 * p.x() / last.x() - 1.0, y = 2.0 * p.y() / last.y() - 1.0;
      a.row(k) << 1, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y;
      b.row(k) = places[static_cast<std::size_t>(k)].transpose();
    }
  }
  // (1 + c x + d y) b = polynomial is linear in all unknowns.
  Eigen::MatrixXd joint = Eigen::MatrixXd::Zero(2 * n, 2 * kTerms + 2);
  Eigen::VectorXd right(2 * n);
  const Eigen::RowVector2d middle = b.colwise().mean();
  const double size = std::max((b.rowwise() - middle).rowwise().norm().maxCoeff(), 1e-9);
  for (Eigen::Index k = 0; k < n; ++k) {
    for (int coordinate = 0; coordinate < 2; ++coordinate) {
      const double value = (b(k, coordinate) - middle[coordinate]) / size;
      joint.block(2 * k + coordinate, coordinate * kTerms, 1, kTerms) = a.row(k);
      joint(2 * k + coordinate, 2 * kTerms) = -value * a(k, 1);
      joint(2 * k + coordinate, 2 * kTerms + 1) = -value * a(k, 2);
      right[2 * k + coordinate] = value;
    }
  }
  const Eigen::MatrixXd normal = joint.transpose() * joint;
  const Eigen::VectorXd solution = normal.ldlt().solve(joint.transpose() * right);
  const double freedom = static_cast<double>(2 * n - joint.cols());
  const double scatter = size * std::sqrt((joint * solution - right).squaredNorm() / std::max(freedom, 1.0));
  // Fewer than this leave no scatter to speak of; then a usual figure of a sharp picture.
  if (freedom < 10 || !std::isfinite(scatter)) return 0.05;
  return std::max(scatter, 0.002);
}

}  // namespace

Result<model::BoardObservation> detect_board(const GrayImage& image, const model::Board& board) {
  const Image<float> picture = to_float(image);
  if (picture.width() < 32 || picture.height() < 32) {
    return unanswerable(fmt::format("an image of {} x {} pixels shows no board", picture.width(), picture.height()));
  }
  auto found =
      board.kind == model::BoardKind::chessboard ? find_chessboard(picture, board) : find_circle_grid(picture, board);
  if (!found) return tl::unexpected(found.error());
  const Places places = ordered(std::move(*found), picture, board);
  const double u_px = grid_scatter_px(places, board);
  model::BoardObservation out;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      model::CornerObservation c;
      c.column = column;
      c.row = row;
      c.pixel = places[static_cast<std::size_t>(row * board.columns + column)];
      c.u_pixel_px = u_px;
      out.corners.push_back(c);
    }
  }
  return out;
}

Image<float> texture_of(const Capture& capture) {
  std::vector<std::size_t> chosen;
  for (const bool phase : {true, false}) {
    for (std::size_t k = 0; k < capture.frames.size() && k < capture.info.frames.size(); ++k) {
      const PatternKind kind = capture.info.frames[k].pattern.kind;
      if (kind == (phase ? PatternKind::phase : PatternKind::white)) chosen.push_back(k);
    }
    if (!chosen.empty()) break;
  }
  if (chosen.empty()) {
    for (std::size_t k = 0; k < capture.frames.size(); ++k) chosen.push_back(k);
  }
  require(!chosen.empty(), "a capture has frames");
  Image<float> sum = to_float(capture.frames[chosen.front()]);
  for (std::size_t i = 1; i < chosen.size(); ++i) {
    const Image<float> next = to_float(capture.frames[chosen[i]]);
    require(next.size() == sum.size(), "the frames of a capture have one size");
    for (std::size_t k = 0; k < sum.size(); ++k) sum.values()[k] += next.values()[k];
  }
  for (float& value : sum.values()) value /= static_cast<float>(chosen.size());
  return sum;
}

Result<model::BoardObservation> observe_board(const Capture& capture, const model::Board& board,
                                              const std::string& name, const model::PhaseLinearisation* table) {
  const Image<float> texture = texture_of(capture);
  // 16 bit keep the fractions of the mean: the full scale of the camera becomes the full scale of 16 bit.
  Image16 picture(texture.width(), texture.height());
  const float scale = 65535.0F / static_cast<float>(capture.saturation_level());
  for (std::size_t k = 0; k < texture.size(); ++k) {
    picture.values()[k] = static_cast<std::uint16_t>(std::lround(std::min(65535.0F, texture.values()[k] * scale)));
  }
  auto observation = detect_board(picture, board);
  if (!observation) return observation;
  observation->name = name;
  for (const CodeAxis axis : {CodeAxis::x, CodeAxis::y}) {
    if (!capture.info.plan.code(axis)) continue;
    const auto* own = table && table->axis == axis ? table : nullptr;
    add_projector_coordinates(*observation, decode::decode_for_measuring(capture, axis, own).map);
  }
  std::size_t coded = 0;
  for (const auto& c : observation->corners) coded += c.x || c.y ? 1 : 0;
  if (coded < 8) {
    return unanswerable(
        fmt::format("the board is seen but only {} of its {} corners have a projector coordinate; light the "
                    "board fully and check the exposure",
                    coded, observation->corners.size()));
  }
  return observation;
}

}  // namespace fringecal::calib
