#include "hw/virtual/light_field.h"

#include "core/parallel.h"

#include <algorithm>
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
  /// Cosine between the line of sight and a sheet's middle normal.
  double view_cosine(const Hit& hit) const {
    const Eigen::Vector3d sight = placed_[static_cast<std::size_t>(hit.object)].camera_in_part - hit.point_in_part;
    return std::abs(sight.z()) / sight.norm();
  }

 private:
  void illuminate(Hit& hit) const;
  bool shadowed(int object, const Eigen::Vector3d& point_in_part) const;

  std::vector<Placed> placed_;
  Grating grating_;
  const model::Projector& projector_;
  Eigen::Vector3d pupil_in_world_;
  double power_, working_distance_mm_, grating_width_mm_, half_width_tangent_;
  double edge_mm_;  // the edge of the coded field is blurred over twice this
};

Tracer::Tracer(const std::vector<Solid>& solids, const Viewpoint& view, const Preset& preset)
    : grating_(preset),
      projector_(view.scanner.projector),
      power_(preset.projector.modulation / grating_.modulation_at_centre()),
      working_distance_mm_(preset.geometry.working_distance_mm),
      grating_width_mm_(preset.grating_width_mm()),
      half_width_tangent_(0.5 * preset.grating_width_mm() / preset.projector.focal_length_mm),
      edge_mm_(6.0 * std::max(grating_.sigma_mm(0.0), grating_.sigma_mm(2.0))) {
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
  const bool self = placed_[static_cast<std::size_t>(object)].solid->can_shade_itself();
  if (placed_.size() < 2 && !self) return false;
  const Eigen::Vector3d point = placed_[static_cast<std::size_t>(object)].solid->world_from_part() * point_in_part;
  for (std::size_t k = 0; k < placed_.size(); ++k) {
    if (static_cast<int>(k) == object && !self) continue;  // the others are convex, or as good as flat
    const Placed& p = placed_[k];
    const Eigen::Vector3d origin = p.part_from_world * point;
    // A body's own surface counts from 0.1 mm on, on the way of about a metre.
    const auto t = p.solid->hit({origin, p.pupil_in_part - origin}, static_cast<int>(k) == object ? 1e-4 : 0.0);
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
  if (u < -edge_mm_ || u > grating_width_mm_ + edge_mm_ || shadowed(hit.object, point)) return;
  double window = 1.0;
  if (u < edge_mm_ || u > grating_width_mm_ - edge_mm_) {
    const double sigma = grating_.sigma_mm(rho2);
    window = normal_cdf(u / sigma) - normal_cdf((u - grating_width_mm_) / sigma);
  }
  const double relative_distance = working_distance_mm_ / distance;
  hit.lit = true;
  hit.u_mm = u;
  hit.rho2 = rho2;
  hit.light = power_ * p.solid->albedo_without_print(point) * cos_incidence * (in_proj.z() / distance) *
              relative_distance * relative_distance * window;  // eq. 1
}

constexpr int kTracedSamples = PointSpread::kCoarse;

class Painter {
 public:
  Painter(const Tracer& tracer, const RayField& rays, LightField& field, const Preset& preset);

  /// First pass: what the middle of each pixel sees.
  void look(int y);
  /// Second pass: what its point spread sees.
  void paint(int y);

 private:
  struct Moments {
    double light, u_mm, variance_mm2, rho2;
  };
  struct Slope {
    double x, y, laplacian;
  };
  static Slope slope(const Image<double>& image, int x, int y) {
    const double here = image(x, y), l = image(x - 1, y), r = image(x + 1, y), a = image(x, y - 1), b = image(x, y + 1);
    return {0.5 * (r - l), 0.5 * (b - a), l + r + a + b - 4.0 * here};
  }
  LightField::Extra place(int x, const Moments& m) const;
  void store(int y, const LightField::Extra& value);
  Moments smooth(int x, int y) const;
  Moments on_print(int x, int y) const;
  void sample(int x, int y);
  void near_silhouettes(int y, std::vector<std::uint8_t>& near) const;

  const Tracer& tracer_;
  const RayField& rays_;
  LightField& field_;
  double period_mm_, variance_px2_;
  PointSpread spread_;
  // Of the pixels' middles. Class: object and shadow in one number; neighbours that differ have an edge between them.
  Image<std::uint8_t> class_, near_print_;
  Image<double> u_mm_, light_, rho2_;
};

Painter::Painter(const Tracer& tracer, const RayField& rays, LightField& field, const Preset& preset)
    : tracer_(tracer),
      rays_(rays),
      field_(field),
      period_mm_(preset.grating.code.period),
      variance_px2_(preset.camera.blur_px * preset.camera.blur_px + 1.0 / 12.0),
      spread_(preset.camera.blur_px),
      class_(rays.x.width(), rays.x.height()),
      near_print_(rays.x.width(), rays.x.height()),
      u_mm_(rays.x.width(), rays.x.height()),
      light_(rays.x.width(), rays.x.height()),
      rho2_(rays.x.width(), rays.x.height()) {}

LightField::Extra Painter::place(int x, const Moments& m) const {
  const double phase = 2.0 * std::numbers::pi * m.u_mm / period_mm_ - std::numbers::pi;
  const double sigma = tracer_.grating().sigma_mm(m.rho2);
  const double sigma_seen = std::sqrt(sigma * sigma + m.variance_mm2);  // eq. 2
  return {x,
          static_cast<float>(m.u_mm),
          static_cast<float>(std::cos(phase)),
          static_cast<float>(std::sin(phase)),
          static_cast<float>(tracer_.grating().first_harmonic(sigma_seen)),
          static_cast<float>(1.0 / sigma_seen),
          static_cast<float>(m.light)};
}

void Painter::store(int y, const LightField::Extra& v) {
  field_.u_mm(v.column, y) = v.u_mm;
  field_.cosine(v.column, y) = v.cosine;
  field_.sine(v.column, y) = v.sine;
  field_.first_harmonic(v.column, y) = v.first_harmonic;
  field_.inverse_sigma(v.column, y) = v.inverse_sigma;
  field_.light(v.column, y) = v.light;
}

void Painter::look(int y) {
  const double pixel = std::abs(rays_.x(1, 0) - rays_.x(0, 0));
  for (int x = 0; x < rays_.x.width(); ++x) {
    const Hit hit = tracer_.trace(rays_.x(x, y), rays_.y(x, y));
    class_(x, y) = static_cast<std::uint8_t>(hit.object < 0 ? 0 : 2 * (hit.object + 1) + (hit.lit ? 1 : 0));
    if (!hit.lit) continue;
    u_mm_(x, y) = hit.u_mm;
    rho2_(x, y) = hit.rho2;
    light_(x, y) = hit.light;
    if (const auto& print = tracer_.solid(hit).print()) {
      const Eigen::Vector2d here = hit.point_in_part.head<2>();
      const double reach_mm = spread_.reach_px() * hit.t * pixel / tracer_.view_cosine(hit);
      near_print_(x, y) = print->near_edge(here, std::numbers::sqrt2 * reach_mm) ? 1 : 0;
      light_(x, y) *= print->albedo(here);
    }
  }
}

Painter::Moments Painter::smooth(int x, int y) const {
  const Slope u = slope(u_mm_, x, y), s = slope(light_, x, y);
  const double light = light_(x, y), v = variance_px2_;
  return {light + 0.5 * v * s.laplacian, u_mm_(x, y) + v * ((u.x * s.x + u.y * s.y) / light + 0.5 * u.laplacian),
          v * (u.x * u.x + u.y * u.y), rho2_(x, y)};  // eq. 3
}

// Without the neighbours' light, which may or may not have the print's albedo in it: shading over a printed edge's
// reach is taken as constant, which leaves out 1e-3 of the light and 1e-3 px of the place.
Painter::Moments Painter::on_print(int x, int y) const {
  const Hit hit = tracer_.trace(rays_.x(x, y), rays_.y(x, y));
  const Hit right = tracer_.trace(rays_.x(x + 1, y), rays_.y(x + 1, y));
  const Hit below = tracer_.trace(rays_.x(x, y + 1), rays_.y(x, y + 1));
  const Eigen::Vector2d here = hit.point_in_part.head<2>();
  const auto seen = tracer_.solid(hit).print()->seen(here, right.point_in_part.head<2>() - here,
                                                     below.point_in_part.head<2>() - here, spread_);
  const Eigen::Vector2d slope_u(right.u_mm - hit.u_mm, below.u_mm - hit.u_mm);
  return {hit.light * seen.albedo, hit.u_mm + slope_u.dot(seen.centroid), slope_u.dot(seen.covariance * slope_u),
          hit.rho2};
}

// Every pixel whose point spread may reach a change of class.
void Painter::near_silhouettes(int y, std::vector<std::uint8_t>& near) const {
  constexpr int kReach = kRayMargin - 1;
  const int width = class_.width(), height = class_.height();
  std::vector<std::uint8_t> column(static_cast<std::size_t>(width) + 1, 0);
  for (int row = std::max(0, y - kReach); row < std::min(height - 1, y + kReach); ++row) {
    const std::uint8_t *here = class_.row(row).data(), *below = class_.row(row + 1).data();
    for (int x = 0; x < width; ++x)
      column[static_cast<std::size_t>(x)] |= static_cast<std::uint8_t>(here[x] ^ below[x]);
  }
  for (int row = std::max(0, y - kReach); row <= std::min(height - 1, y + kReach); ++row) {
    const std::uint8_t* here = class_.row(row).data();
    for (int x = 0; x + 1 < width; ++x) {
      const auto change = static_cast<std::uint8_t>(here[x] ^ here[x + 1]);
      column[static_cast<std::size_t>(x)] |= change;
      column[static_cast<std::size_t>(x) + 1] |= change;
    }
  }
  for (int x = 0; x < width; ++x) {
    std::uint8_t any = 0;
    for (int k = std::max(0, x - kReach); k <= std::min(width - 1, x + kReach); ++k)
      any |= column[static_cast<std::size_t>(k)];
    near[static_cast<std::size_t>(x)] = any;
  }
}

void Painter::sample(int x, int y) {
  const Eigen::Vector2d here(rays_.x(x, y), rays_.y(x, y));
  const Eigen::Vector2d dx =
      0.5 * Eigen::Vector2d(rays_.x(x + 1, y) - rays_.x(x - 1, y), rays_.y(x + 1, y) - rays_.y(x - 1, y));
  const Eigen::Vector2d dy =
      0.5 * Eigen::Vector2d(rays_.x(x, y + 1) - rays_.x(x, y - 1), rays_.y(x, y + 1) - rays_.y(x, y - 1));
  struct Share {
    int object;
    double light, u_mm, u2_mm2, rho2, u_first_mm;
  };
  std::vector<Share> shares;
  for (const Eigen::Vector2d& s : spread_.samples(kTracedSamples)) {
    const Eigen::Vector2d ray = here + s.x() * dx + s.y() * dy;
    const Hit hit = tracer_.trace(ray.x(), ray.y());
    if (!hit.lit) continue;
    const auto& print = tracer_.solid(hit).print();
    const double light = hit.light * (print ? print->albedo(hit.point_in_part.head<2>()) : 1.0) / kTracedSamples;
    auto share = std::find_if(shares.begin(), shares.end(), [&](const Share& o) { return o.object == hit.object; });
    if (share == shares.end()) share = shares.insert(share, Share{hit.object, 0, 0, 0, 0, hit.u_mm});
    const double u_mm = hit.u_mm - share->u_first_mm;
    share->light += light;
    share->u_mm += light * u_mm;
    share->u2_mm2 += light * u_mm * u_mm;
    share->rho2 += light * hit.rho2;
  }
  std::erase_if(shares, [](const Share& s) { return !(s.light > 0); });
  for (std::size_t k = 0; k < shares.size(); ++k) {
    const Share& s = shares[k];
    const double mean = s.u_mm / s.light, variance = std::max(0.0, s.u2_mm2 / s.light - mean * mean);
    const auto value = place(x, {s.light, s.u_first_mm + mean, variance, s.rho2 / s.light});
    if (k == 0) {
      store(y, value);
    } else {
      field_.extras[static_cast<std::size_t>(y)].push_back(value);
    }
  }
}

void Painter::paint(int y) {
  std::vector<std::uint8_t> near(static_cast<std::size_t>(class_.width()));
  near_silhouettes(y, near);
  for (int x = kRayMargin; x < class_.width() - kRayMargin; ++x) {
    if (near[static_cast<std::size_t>(x)] != 0) {
      sample(x, y);
    } else if ((class_(x, y) & 1) != 0) {
      store(y, place(x, near_print_(x, y) != 0 ? on_print(x, y) : smooth(x, y)));
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

RayField::RayField(const model::Camera& camera)
    : x(camera.width_px + 2 * kRayMargin, camera.height_px + 2 * kRayMargin), y(x.width(), x.height()) {
  parallel_for(y.height(), [&](int row) {
    for (int column = 0; column < x.width(); ++column) {
      const auto ray = camera.ray({column - kRayMargin, row - kRayMargin});
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
  Painter painter(tracer, rays, field, preset);
  parallel_for(rays.x.height(), [&](int y) { painter.look(y); });
  parallel_for(rays.x.height() - 2 * kRayMargin, [&](int y) { painter.paint(y + kRayMargin); });
  return field;
}

}  // namespace fringecal::virt
