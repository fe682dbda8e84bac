#include "hw/virtual/light_field.h"

#include "core/parallel.h"

#include <algorithm>
#include <array>
#include <numbers>

namespace fringecal::virt {
namespace {

// A solid with its way to the other frames.
struct Placed {
  const Solid* solid;
  Rigid3 proj_from_part, part_from_world;
  Eigen::Matrix3d part_from_cam_rotation, proj_from_part_rotation;
  Eigen::Vector3d camera_in_part, pupil_in_part;
};

// What a ray meets.
struct Hit {
  int object = -1;
  double t = 0;
  Eigen::Vector3d point_in_part;
  bool lit = false;
  double u_mm = 0, rho2 = 0;
  double light = 0;  // eq. 1 without the print's albedo
};

class Tracer {
 public:
  Tracer(const std::vector<Solid>& solids, const Viewpoint& view, const Preset& preset);
  Hit trace(double x, double y) const;
  const Solid& solid(const Hit& hit) const { return *placed_[static_cast<std::size_t>(hit.object)].solid; }
  const Grating& grating() const { return grating_; }

 private:
  void illuminate(Hit& hit) const;
  bool shadowed(int object, const Eigen::Vector3d& point_in_part) const;

  std::vector<Placed> placed_;
  Grating grating_;
  const model::Projector& projector_;
  Eigen::Vector3d pupil_in_world_;
  double power_, working_distance_mm_, grating_width_mm_, half_width_tangent_;
};

Tracer::Tracer(const std::vector<Solid>& solids, const Viewpoint& view, const Preset& preset)
    : grating_(preset),
      projector_(view.scanner.projector),
      power_(preset.projector.modulation / grating_.modulation_at_centre()),
      working_distance_mm_(preset.geometry.working_distance_mm),
      grating_width_mm_(preset.grating_width_mm()),
      half_width_tangent_(0.5 * preset.grating_width_mm() / preset.projector.focal_length_mm) {
  const Rigid3 preset_from_proj = view.preset_from_cam * view.scanner.proj_from_cam.inverse();
  pupil_in_world_ = preset_from_proj.translation_mm;
  for (const Solid& solid : solids) {
    const Rigid3 part_from_world = solid.world_from_part().inverse();
    const Rigid3 part_from_cam = part_from_world * view.preset_from_cam;
    const Rigid3 part_from_proj = part_from_world * preset_from_proj;
    const Rigid3 proj_from_part = part_from_proj.inverse();
    placed_.push_back({&solid, proj_from_part, part_from_world, part_from_cam.rotation_matrix(),
                       proj_from_part.rotation_matrix(), part_from_cam.translation_mm, part_from_proj.translation_mm});
  }
}

Hit Tracer::trace(double x, double y) const {
  Hit best;
  const Eigen::Vector3d direction_in_cam(x, y, 1.0);
  for (std::size_t k = 0; k < placed_.size(); ++k) {
    const Ray ray{placed_[k].camera_in_part, placed_[k].part_from_cam_rotation * direction_in_cam};
    const auto t = placed_[k].solid->hit(ray, 0.0);
    if (!t || (best.object >= 0 && *t >= best.t)) continue;
    best.object = static_cast<int>(k);
    best.t = *t;
    best.point_in_part = ray.origin + *t * ray.direction;
  }
  if (best.object >= 0) illuminate(best);
  return best;
}

bool Tracer::shadowed(int object, const Eigen::Vector3d& point_in_part) const {
  if (placed_.size() < 2) return false;
  const Eigen::Vector3d point = placed_[static_cast<std::size_t>(object)].solid->world_from_part() * point_in_part;
  for (std::size_t k = 0; k < placed_.size(); ++k) {
    if (static_cast<int>(k) == object) continue;  // every solid is convex, or as good as flat
    const Placed& p = placed_[k];
    const Eigen::Vector3d origin = p.part_from_world * point;
    const auto t = p.solid->hit({origin, p.pupil_in_part - origin}, 0.0);
    if (t && *t < 1.0) return true;
  }
  return false;
}

void Tracer::illuminate(Hit& hit) const {
  const Placed& p = placed_[static_cast<std::size_t>(hit.object)];
  const Eigen::Vector3d point = hit.point_in_part;
  Eigen::Vector3d normal = p.solid->normal(point);
  if (p.solid->is_sheet() && normal.dot(p.camera_in_part - point) < 0) normal = -normal;
  const Eigen::Vector3d way = p.pupil_in_part - point;
  const double distance = way.norm(), cos_incidence = normal.dot(way) / distance;
  if (!(cos_incidence > 0)) return;
  const Eigen::Vector3d in_proj = p.proj_from_part_rotation * point + p.proj_from_part.translation_mm;
  if (!(in_proj.z() > 0)) return;
  const double x = in_proj.x() / in_proj.z(), y = in_proj.y() / in_proj.z();
  double xd, yd;
  model::distort(projector_.distortion.data(), x, y, xd, yd);
  const double u = projector_.x->f * xd + projector_.x->u0;
  const double rho2 = (xd * xd + yd * yd) / (half_width_tangent_ * half_width_tangent_);
  const double sigma = grating_.sigma_mm(grating_.first_harmonic(rho2));
  if (u < -6 * sigma || u > grating_width_mm_ + 6 * sigma || shadowed(hit.object, point)) return;
  double window = 1.0;
  if (u < 6 * sigma || u > grating_width_mm_ - 6 * sigma) {
    window = normal_cdf(u / sigma) - normal_cdf((u - grating_width_mm_) / sigma);
  }
  const double relative_distance = working_distance_mm_ / distance;
  hit.lit = true;
  hit.u_mm = u;
  hit.rho2 = rho2;
  hit.light = power_ * p.solid->albedo_without_print(point) * cos_incidence * (in_proj.z() / distance) *
              relative_distance * relative_distance * window;  // eq. 1
}

constexpr int kSilhouetteSamples = 64;

const std::array<std::array<double, 2>, kSilhouetteSamples>& silhouette_samples() {
  static const auto samples = [] {
    std::array<std::array<double, 2>, kSilhouetteSamples> out;
    for (unsigned i = 0; i < kSilhouetteSamples; ++i) {
      unsigned reversed = 0;
      for (unsigned bit = 0; bit < 6; ++bit) reversed |= ((i >> bit) & 1U) << (5 - bit);
      out[i] = {(i + 0.5) / kSilhouetteSamples - 0.5, (reversed + 0.5) / kSilhouetteSamples - 0.5};
    }
    return out;
  }();
  return samples;
}

class Painter {
 public:
  Painter(const Tracer& tracer, const RayField& rays, LightField& field, double period_mm)
      : tracer_(tracer), rays_(rays), field_(field), period_mm_(period_mm), class_(rays.x.width(), rays.x.height()) {}

  void paint_row(int y);
  void refine_row(int y);

 private:
  // Objects and shadow in one number; neighbours that differ have an edge between them.
  static std::uint8_t class_of(const Hit& hit) {
    return static_cast<std::uint8_t>(hit.object < 0 ? 0 : 2 * (hit.object + 1) + (hit.lit ? 1 : 0));
  }
  LightField::Extra place(int x, double u_mm, double rho2, double light) const;
  void store(int y, const LightField::Extra& value);
  void average_print(int x, int y, const Hit& hit, double& u_mm, double& light) const;
  bool at_edge(int x, int y) const;

  const Tracer& tracer_;
  const RayField& rays_;
  LightField& field_;
  double period_mm_;
  Image<std::uint8_t> class_;
};

LightField::Extra Painter::place(int x, double u_mm, double rho2, double light) const {
  const double phase = 2.0 * std::numbers::pi * u_mm / period_mm_ - std::numbers::pi;
  const double e1 = tracer_.grating().first_harmonic(rho2);
  return {x,
          static_cast<float>(u_mm),
          static_cast<float>(std::cos(phase)),
          static_cast<float>(std::sin(phase)),
          static_cast<float>(e1),
          static_cast<float>(1.0 / tracer_.grating().sigma_mm(e1)),
          static_cast<float>(light)};
}

void Painter::store(int y, const LightField::Extra& v) {
  field_.u_mm(v.column, y) = v.u_mm;
  field_.cosine(v.column, y) = v.cosine;
  field_.sine(v.column, y) = v.sine;
  field_.first_harmonic(v.column, y) = v.first_harmonic;
  field_.inverse_sigma(v.column, y) = v.inverse_sigma;
  field_.light(v.column, y) = v.light;
}

// The pixel's square on the board is a parallelogram to 1e-4 of its side; its sides come from the neighbouring rays.
void Painter::average_print(int x, int y, const Hit& hit, double& u_mm, double& light) const {
  const PrintedBoard& print = *tracer_.solid(hit).print();
  const Eigen::Vector2d here = hit.point_in_part.head<2>();
  if (!print.near_edge(here, 2.0 * hit.t * std::abs(rays_.x(1, 0) - rays_.x(0, 0)))) {
    light *= print.albedo(here);
    return;
  }
  const int step_x = x + 1 < rays_.x.width() ? 1 : -1, step_y = y + 1 < rays_.x.height() ? 1 : -1;
  const Hit right = tracer_.trace(rays_.x(x + step_x, y), rays_.y(x + step_x, y));
  const Hit below = tracer_.trace(rays_.x(x, y + step_y), rays_.y(x, y + step_y));
  if (right.object != hit.object || below.object != hit.object || !right.lit || !below.lit) {
    light *= print.albedo(here);  // at the board's own edge: refine_row() samples it
    return;
  }
  const auto mean = print.footprint(here, step_x * (right.point_in_part.head<2>() - here),
                                    step_y * (below.point_in_part.head<2>() - here));
  light *= mean.albedo;
  u_mm += mean.centroid.x() * step_x * (right.u_mm - hit.u_mm) + mean.centroid.y() * step_y * (below.u_mm - hit.u_mm);
}

void Painter::paint_row(int y) {
  for (int x = 0; x < rays_.x.width(); ++x) {
    const Hit hit = tracer_.trace(rays_.x(x, y), rays_.y(x, y));
    class_(x, y) = class_of(hit);
    if (!hit.lit) continue;
    double u_mm = hit.u_mm, light = hit.light;
    if (tracer_.solid(hit).print()) average_print(x, y, hit, u_mm, light);
    store(y, place(x, u_mm, hit.rho2, light));
  }
}

bool Painter::at_edge(int x, int y) const {
  const std::uint8_t here = class_(x, y);
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      if (class_.contains(x + dx, y + dy) && class_(x + dx, y + dy) != here) return true;
    }
  }
  return false;
}

void Painter::refine_row(int y) {
  const int width = rays_.x.width(), height = rays_.x.height();
  const int up = std::max(y - 1, 0), down = std::min(y + 1, height - 1);
  for (int x = 0; x < width; ++x) {
    if (!at_edge(x, y)) continue;
    const int left = std::max(x - 1, 0), right = std::min(x + 1, width - 1);
    const Eigen::Vector2d here(rays_.x(x, y), rays_.y(x, y));
    const Eigen::Vector2d dx =
        Eigen::Vector2d(rays_.x(right, y) - rays_.x(left, y), rays_.y(right, y) - rays_.y(left, y)) / (right - left);
    const Eigen::Vector2d dy =
        Eigen::Vector2d(rays_.x(x, down) - rays_.x(x, up), rays_.y(x, down) - rays_.y(x, up)) / (down - up);
    struct Share {
      int object;
      double light, u_mm, rho2;
    };
    std::vector<Share> shares;
    for (const auto& [a, b] : silhouette_samples()) {
      const Eigen::Vector2d ray = here + a * dx + b * dy;
      const Hit hit = tracer_.trace(ray.x(), ray.y());
      if (!hit.lit) continue;
      const auto& print = tracer_.solid(hit).print();
      const double light = hit.light * (print ? print->albedo(hit.point_in_part.head<2>()) : 1.0) / kSilhouetteSamples;
      auto share = std::find_if(shares.begin(), shares.end(), [&](const Share& s) { return s.object == hit.object; });
      if (share == shares.end()) share = shares.insert(share, Share{hit.object, 0, 0, 0});
      share->light += light;
      share->u_mm += light * hit.u_mm;
      share->rho2 += light * hit.rho2;
    }
    std::erase_if(shares, [](const Share& s) { return !(s.light > 0); });
    field_.light(x, y) = 0.0F;
    for (std::size_t k = 0; k < shares.size(); ++k) {
      const Share& s = shares[k];
      const auto value = place(x, s.u_mm / s.light, s.rho2 / s.light, s.light);
      if (k == 0) {
        store(y, value);
      } else {
        field_.extras[static_cast<std::size_t>(y)].push_back(value);
      }
    }
  }
}

}  // namespace

LightField::LightField(int width, int height)
    : u_mm(width, height),
      cosine(width, height, 1.0F),
      sine(width, height),
      first_harmonic(width, height),
      inverse_sigma(width, height, 1.0F),
      light(width, height),
      extras(static_cast<std::size_t>(height)) {}

LightRow LightField::row(int y) const {
  return {u_mm.row(y), cosine.row(y), sine.row(y), first_harmonic.row(y), inverse_sigma.row(y), light.row(y)};
}

RayField::RayField(const model::Camera& camera, int margin_px)
    : margin(margin_px),
      x(camera.width_px + 2 * margin_px, camera.height_px + 2 * margin_px),
      y(camera.width_px + 2 * margin_px, camera.height_px + 2 * margin_px) {
  parallel_for(y.height(), [&](int row) {
    for (int column = 0; column < x.width(); ++column) {
      const auto ray = camera.ray({column - margin, row - margin});
      require(ray.has_value(), "the preset's camera distortion can be inverted on its whole sensor");
      x(column, row) = ray->x();
      y(column, row) = ray->y();
    }
  });
}

LightField light_field(const std::vector<Solid>& solids, const RayField& rays, const Viewpoint& view,
                       const Preset& preset) {
  require(solids.size() < 127, "a scene has fewer than 127 objects");
  LightField field(rays.x.width(), rays.x.height());
  const Tracer tracer(solids, view, preset);
  Painter painter(tracer, rays, field, preset.grating.code.period);
  parallel_for(rays.x.height(), [&](int y) { painter.paint_row(y); });
  parallel_for(rays.x.height(), [&](int y) { painter.refine_row(y); });
  return field;
}

}  // namespace fringecal::virt
