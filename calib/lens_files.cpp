#include "calib/lens_files.h"

#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <sstream>
#include <vector>

namespace fringecal::calib {
namespace {

constexpr double kMmPerM = 1000.0;
constexpr int kMostTerms = 100;      // of a matrix' side; OpenCV's longest list of distortions has 14
constexpr double kMostPixels = 1e6;  // of an image side, far beyond any sensor

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& sentence) {
  throw InputError(fmt::format("{}: {}", file.string(), sentence));
}

/// The lines of a comment, each behind a '#'.
std::string commented(const std::string& comment) {
  std::string out, line;
  std::istringstream lines(comment);
  while (std::getline(lines, line)) out += "# " + line + "\n";
  return out;
}

// fmt writes a double with the fewest digits that read back to it.
std::string cameramodel_text(const PlacedCamera& p, const std::string& comment) {
  const auto& c = p.camera;
  const auto& k = c.distortion;
  const bool straight = std::all_of(k.begin(), k.end(), [](double v) { return v == 0.0; });
  const std::size_t terms = straight ? 0 : k[4] == 0.0 ? 4 : 5;
  std::string intrinsics = fmt::format("{}, {}, {}, {}", c.fx_px, c.fy_px, c.cx_px, c.cy_px);
  for (std::size_t i = 0; i < terms; ++i) intrinsics += fmt::format(", {}", k[i]);
  const Eigen::Vector3d r = vector_from_rotation(p.cam_from_reference.rotation),
                        t = p.cam_from_reference.translation_mm / kMmPerM;
  return commented(comment) + fmt::format(
                                  "{{\n"
                                  "    'lensmodel':  '{}',\n\n"
                                  "    # fx, fy, cx, cy, then the distortion\n"
                                  "    'intrinsics': [ {},],\n\n"
                                  "    # rotation vector (rad) and translation (m), from the reference\n"
                                  "    'extrinsics': [ {}, {}, {}, {}, {}, {},],\n\n"
                                  "    'imagersize': [ {}, {},],\n"
                                  "}}\n",
                                  straight     ? "LENSMODEL_PINHOLE"
                                  : terms == 4 ? "LENSMODEL_OPENCV4"
                                               : "LENSMODEL_OPENCV5",
                                  intrinsics, r.x(), r.y(), r.z(), t.x(), t.y(), t.z(), c.width_px, c.height_px);
}

std::string opencv_text(const PlacedCamera& p, const std::string& comment) {
  const auto& c = p.camera;
  cv::Mat matrix = cv::Mat::eye(3, 3, CV_64F), distortion(1, 5, CV_64F), r(3, 3, CV_64F), t(3, 1, CV_64F);
  matrix.at<double>(0, 0) = c.fx_px;
  matrix.at<double>(1, 1) = c.fy_px;
  matrix.at<double>(0, 2) = c.cx_px;
  matrix.at<double>(1, 2) = c.cy_px;
  const Eigen::Matrix3d rotation = p.cam_from_reference.rotation_matrix();
  for (int i = 0; i < 5; ++i) distortion.at<double>(i) = c.distortion[static_cast<std::size_t>(i)];
  for (int i = 0; i < 3; ++i) {
    t.at<double>(i) = p.cam_from_reference.translation_mm[i];
    for (int j = 0; j < 3; ++j) r.at<double>(i, j) = rotation(i, j);
  }
  cv::FileStorage file(".yml", cv::FileStorage::WRITE | cv::FileStorage::MEMORY | cv::FileStorage::FORMAT_YAML);
  std::string line;
  std::istringstream lines(comment);
  while (std::getline(lines, line)) file.writeComment(line);
  file << "image_width" << c.width_px << "image_height" << c.height_px << "camera_matrix" << matrix
       << "distortion_coefficients" << distortion << "R" << r << "T" << t;
  return file.releaseAndGetString();
}

/// The value of a key of mrcal's file, which is a Python dictionary: the text between the brackets, or the quoted word.
std::string_view value_of(std::string_view text, const std::string& key, char open, char close) {
  const std::string quoted = "'" + key + "'";
  std::size_t at = text.find(quoted);
  if (at == std::string_view::npos) at = text.find("\"" + key + "\"");
  if (at == std::string_view::npos) return {};
  at = text.find(':', at);
  if (at == std::string_view::npos) return {};
  const std::size_t first = text.find_first_not_of(" \t\r\n", at + 1);
  if (first == std::string_view::npos || (text[first] != open && !(open == '\'' && text[first] == '"'))) return {};
  const std::size_t end = text.find(text[first] == '"' ? '"' : close, first + 1);
  return end == std::string_view::npos ? std::string_view() : text.substr(first + 1, end - first - 1);
}

std::optional<std::vector<double>> numbers_in(std::string_view list) {
  std::vector<double> out;
  while (true) {
    const std::size_t first = list.find_first_not_of(" \t\r\n,");
    if (first == std::string_view::npos) return out;
    list.remove_prefix(first);
    if (list.front() == '+') list.remove_prefix(1);
    double value = 0;
    const auto [end, error] = std::from_chars(list.data(), list.data() + list.size(), value);
    if (error != std::errc() || !std::isfinite(value)) return std::nullopt;
    out.push_back(value);
    list.remove_prefix(static_cast<std::size_t>(end - list.data()));
  }
}

PlacedCamera from_cameramodel(const std::filesystem::path& file, const std::string& bytes) {
  std::string text, line;
  std::istringstream lines(bytes);
  while (std::getline(lines, line)) text += line.substr(0, line.find('#')) + "\n";
  std::string lens(value_of(text, "lensmodel", '\'', '\''));
  if (lens.empty()) lens = value_of(text, "lens_model", '\'', '\'');
  const std::size_t terms = lens == "LENSMODEL_PINHOLE"   ? 0
                            : lens == "LENSMODEL_OPENCV4" ? 4
                            : lens == "LENSMODEL_OPENCV5" ? 5
                                                          : 6;
  if (terms > 5) {
    refuse(file, fmt::format("lens model '{}'; fringecal reads LENSMODEL_PINHOLE, LENSMODEL_OPENCV4 and "
                             "LENSMODEL_OPENCV5: calibrate with one of them",
                             lens));
  }
  const auto intrinsics = numbers_in(value_of(text, "intrinsics", '[', ']')),
             extrinsics = numbers_in(value_of(text, "extrinsics", '[', ']')),
             size = numbers_in(value_of(text, "imagersize", '[', ']'));
  if (!intrinsics || intrinsics->size() != 4 + terms) {
    refuse(file, fmt::format("'intrinsics' must be {} numbers for {}", 4 + terms, lens));
  }
  if (!extrinsics || extrinsics->size() != 6) refuse(file, "'extrinsics' must be 6 numbers");
  if (!size || size->size() != 2) refuse(file, "'imagersize' must be 2 numbers");
  PlacedCamera p;
  p.camera.fx_px = (*intrinsics)[0];
  p.camera.fy_px = (*intrinsics)[1];
  p.camera.cx_px = (*intrinsics)[2];
  p.camera.cy_px = (*intrinsics)[3];
  std::copy(intrinsics->begin() + 4, intrinsics->end(), p.camera.distortion.begin());
  for (const double side : *size) {
    if (!(side >= 1 && side <= kMostPixels)) refuse(file, fmt::format("'imagersize' holds {}, no image's side", side));
  }
  p.camera.width_px = static_cast<int>((*size)[0]);
  p.camera.height_px = static_cast<int>((*size)[1]);
  const auto& e = *extrinsics;
  p.cam_from_reference = {rotation_from_vector({e[0], e[1], e[2]}), kMmPerM * Eigen::Vector3d(e[3], e[4], e[5])};
  return p;
}

PlacedCamera from_opencv(const std::filesystem::path& file, const std::string& bytes) {
  try {
    const cv::FileStorage storage(bytes, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    const auto matrix_of = [&](const char* key) {
      cv::Mat m;
      const cv::FileNode node = storage[key];
      if (node.empty()) return m;
      // OpenCV allocates what the file announces before it looks at the numbers.
      const cv::FileNode type = node["dt"], data = node["data"];
      const auto side = [&](const char* name) -> std::size_t {
        const cv::FileNode n = node[name];
        const int value = n.isInt() ? static_cast<int>(n) : -1;
        if (value < 0 || value > kMostTerms) refuse(file, fmt::format("'{}' of '{}' is no matrix' side", name, key));
        return static_cast<std::size_t>(value);
      };
      const std::size_t terms = side("rows") * side("cols");
      if (!type.isString() || type.string().size() != 1 || !data.isSeq() || data.size() != terms) {
        refuse(file, fmt::format("'{}' must be a matrix of single numbers, as many as its rows and cols say", key));
      }
      if (terms > 0) node >> m;
      if (m.empty()) return m;
      m.convertTo(m, CV_64F);
      return m;
    };
    const cv::Mat matrix = matrix_of("camera_matrix");
    cv::Mat distortion = matrix_of("distortion_coefficients");
    if (matrix.rows != 3 || matrix.cols != 3) refuse(file, "'camera_matrix' must be 3 x 3");
    if (matrix.at<double>(0, 1) != 0) refuse(file, "'camera_matrix' has a skew, which the camera of fringecal has not");
    const int terms = static_cast<int>(distortion.total());
    if (terms != 0 && terms != 4 && terms != 5 &&
        !(terms > 5 && cv::countNonZero(distortion.reshape(1, 1).colRange(5, terms)) == 0)) {
      refuse(file, fmt::format("{} 'distortion_coefficients'; fringecal reads 4 or 5 (k1, k2, p1, p2, k3), or more "
                               "where the rest are zero",
                               terms));
    }
    PlacedCamera p;
    p.camera.fx_px = matrix.at<double>(0, 0);
    p.camera.fy_px = matrix.at<double>(1, 1);
    p.camera.cx_px = matrix.at<double>(0, 2);
    p.camera.cy_px = matrix.at<double>(1, 2);
    for (int i = 0; i < std::min(terms, 5); ++i) {
      p.camera.distortion[static_cast<std::size_t>(i)] = distortion.reshape(1, 1).at<double>(i);
    }
    p.camera.width_px = static_cast<int>(storage["image_width"]);
    p.camera.height_px = static_cast<int>(storage["image_height"]);
    const cv::Mat r = matrix_of("R"), t = matrix_of("T");
    if (r.empty() != t.empty()) refuse(file, "'R' and 'T' come together");
    if (!r.empty()) {
      if (r.rows != 3 || r.cols != 3 || t.total() != 3) refuse(file, "'R' must be 3 x 3 and 'T' three numbers");
      Eigen::Matrix3d rotation;
      for (int i = 0; i < 3; ++i) {
        p.cam_from_reference.translation_mm[i] = t.reshape(1, 1).at<double>(i);
        for (int j = 0; j < 3; ++j) rotation(i, j) = r.at<double>(i, j);
      }
      if (!((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-9) ||
          !(rotation.determinant() > 0)) {
        refuse(file, "'R' is not a rotation");
      }
      p.cam_from_reference.rotation = Eigen::Quaterniond(rotation).normalized();
    }
    return p;
  } catch (const InputError&) {
    throw;
  } catch (const std::exception&) {  // OpenCV's parser also lets errors of the standard library through
    refuse(file, "neither a .cameramodel of mrcal nor a YAML file of OpenCV");
  }
}

/// Eq. 1 of one axis; `size`: stripes.
struct AxisAsPixels {
  double f = 0, c = 0;
  int size = 0;
};
AxisAsPixels in_stripes(const model::ProjectorAxis& axis) {
  const double w = axis.code.stripe_width();
  return {axis.f / w, axis.u0 / w - 0.5, axis.code.stripes()};  // eq. 1
}

}  // namespace

const char* ending_of(LensFormat format) { return format == LensFormat::mrcal ? ".cameramodel" : ".yml"; }

std::string lens_file(const PlacedCamera& placed, LensFormat format, const std::string& comment) {
  return format == LensFormat::mrcal ? cameramodel_text(placed, comment) : opencv_text(placed, comment);
}

PlacedCamera read_lens_file(const std::filesystem::path& file) {
  const std::string bytes = read_bytes(file);
  PlacedCamera p = bytes.find("lens") != std::string::npos && bytes.find("'imagersize'") != std::string::npos
                       ? from_cameramodel(file, bytes)
                       : from_opencv(file, bytes);
  const auto& c = p.camera;
  bool finite = p.cam_from_reference.translation_mm.allFinite();
  for (const double v : {c.fx_px, c.fy_px, c.cx_px, c.cy_px}) finite = finite && std::isfinite(v);
  for (const double v : c.distortion) finite = finite && std::isfinite(v);
  if (!finite || c.width_px <= 0 || c.height_px <= 0 || !(c.fx_px * c.fy_px != 0)) {
    refuse(file, "image size and focal lengths must be there, all numbers finite");
  }
  return p;
}

model::Camera camera_of(const model::Projector& projector) {
  const auto x = projector.x ? std::optional(in_stripes(*projector.x)) : std::nullopt;
  const auto y = projector.y ? std::optional(in_stripes(*projector.y)) : std::nullopt;
  require(x || y, "a projector codes an axis");
  const AxisAsPixels& one = x ? *x : *y;
  const AxisAsPixels other{one.f, 0.5 * (one.size - 1), one.size};
  const AxisAsPixels ax = x.value_or(other), ay = y.value_or(other);
  return {.width_px = ax.size,
          .height_px = ay.size,
          .fx_px = ax.f,
          .fy_px = ay.f,
          .cx_px = ax.c,
          .cy_px = ay.c,
          .distortion = projector.distortion,
          .pixel_mm = {}};
}

model::Projector projector_of(const model::Camera& camera, const model::Projector& like) {
  model::Projector out = like;
  const auto set = [](std::optional<model::ProjectorAxis>& axis, double f, double c) {
    if (!axis) return;
    const double w = axis->code.stripe_width();
    axis->f = f * w;
    axis->u0 = (c + 0.5) * w;
  };
  set(out.x, camera.fx_px, camera.cx_px);
  set(out.y, camera.fy_px, camera.cy_px);
  out.distortion = camera.distortion;
  return out;
}

}  // namespace fringecal::calib
