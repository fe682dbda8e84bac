#include "calib/halves.h"

#include <fmt/format.h>

namespace fringecal::calib {

DistortionTerms terms_of(const model::Distortion& k) {
  if (k[4] != 0) return DistortionTerms::full;
  if (k[2] != 0 || k[3] != 0) return DistortionTerms::radial_tangential;
  return k[0] != 0 || k[1] != 0 ? DistortionTerms::radial : DistortionTerms::none;
}

Result<std::pair<model::Scanner, model::Scanner>> solve_halves(const model::Scanner& s) {
  if (!s.board || s.observations.size() < 6) {
    return unanswerable(
        fmt::format("the Scanner '{}' keeps {} poses of its board; halves need six, ten or more are good", s.name,
                    s.observations.size()));
  }
  PatternPlan plan;
  if (s.projector.x) plan.x = s.projector.x->code;
  if (s.projector.y) plan.y = s.projector.y->code;
  CalibrationOptions how;
  how.camera_terms = terms_of(s.camera.distortion);
  how.projector_terms = terms_of(s.projector.distortion);
  how.working_distance_mm = s.working_distance_mm;
  how.u_flatness_mm = s.u_flatness_mm;
  std::pair<model::Scanner, model::Scanner> out;
  for (const std::size_t half : {0U, 1U}) {
    std::vector<model::BoardObservation> poses;
    for (std::size_t i = half; i < s.observations.size(); i += 2) poses.push_back(s.observations[i]);
    how.flats.clear();
    for (std::size_t i = half; i < s.flats.size(); i += 2) how.flats.push_back(s.flats[i]);
    auto solved = calibrate(poses, *s.board, s.camera.width_px, s.camera.height_px, plan, how);
    if (!solved) {
      return unanswerable(
          fmt::format("the {} half of the poses: {}", half == 0 ? "first" : "second", solved.error().sentence));
    }
    solved->name = fmt::format("{}, {} half", s.name, half == 0 ? "first" : "second");
    (half == 0 ? out.first : out.second) = std::move(*solved);
  }
  return out;
}

}  // namespace fringecal::calib
