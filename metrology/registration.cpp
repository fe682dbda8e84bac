#include "metrology/registration.h"

#include "core/error.h"
#include "core/parallel.h"
#include "core/statistics.h"
#include "fitting/fit.h"

#include <fmt/format.h>
#include <Eigen/Dense>
#include <nanoflann.hpp>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>

namespace fringecal::metrology {
namespace {

constexpr std::size_t kMinPairs = 100;  // below, a pair of views says nothing about itself
constexpr double kTukey = 4.685;        // 95 % efficiency on normal residuals

// ---- spheres

struct Match {
  std::size_t view_sphere, common;
};

struct Joined {
  Rigid3 part_from_view;
  std::vector<Match> matches;
};

Rigid3 to_rigid(const fitting::RigidFit& fit) { return {Eigen::Quaterniond(fit.rotation), fit.translation_mm}; }

std::optional<Rigid3> motion_of(const std::vector<Match>& matches, const std::vector<Eigen::Vector3d>& view,
                                const std::vector<Eigen::Vector3d>& common) {
  std::vector<Eigen::Vector3d> from, to;
  for (const auto& m : matches) {
    from.push_back(view[m.view_sphere]);
    to.push_back(common[m.common]);
  }
  const auto fit = fitting::fit_rigid(from, to);
  if (!fit) return std::nullopt;
  return to_rigid(*fit);
}

/// Every centre of the view with the nearest common one within match_mm, each common one at most once.
std::vector<Match> matches_under(const Rigid3& motion, const std::vector<Eigen::Vector3d>& view,
                                 const std::vector<Eigen::Vector3d>& common, double match_mm) {
  std::vector<Match> out;
  std::vector<bool> taken(common.size(), false);
  for (std::size_t i = 0; i < view.size(); ++i) {
    const Eigen::Vector3d x = motion * view[i];
    for (std::size_t j = 0; j < common.size(); ++j) {
      if (taken[j] || !((x - common[j]).norm() <= match_mm)) continue;
      out.push_back({i, j});
      taken[j] = true;
      break;
    }
  }
  return out;
}

/// The motion that brings most centres of the view onto common ones.
std::optional<Joined> join(const std::vector<Eigen::Vector3d>& view, const std::vector<Eigen::Vector3d>& common,
                           double match_mm) {
  std::optional<Joined> best;
  const auto agrees = [&](std::size_t a, std::size_t b, std::size_t ja, std::size_t jb) {
    return std::abs((view[a] - view[b]).norm() - (common[ja] - common[jb]).norm()) <= match_mm;
  };
  for (std::size_t a = 0; a < view.size(); ++a) {
    for (std::size_t b = a + 1; b < view.size(); ++b) {
      for (std::size_t c = b + 1; c < view.size(); ++c) {
        for (std::size_t ja = 0; ja < common.size(); ++ja) {
          for (std::size_t jb = 0; jb < common.size(); ++jb) {
            if (jb == ja || !agrees(a, b, ja, jb)) continue;
            for (std::size_t jc = 0; jc < common.size(); ++jc) {
              if (jc == ja || jc == jb || !agrees(a, c, ja, jc) || !agrees(b, c, jb, jc)) continue;
              auto motion = motion_of({{a, ja}, {b, jb}, {c, jc}}, view, common);
              if (!motion) continue;
              auto matches = matches_under(*motion, view, common, match_mm);
              if (matches.size() < 3 || (best && matches.size() <= best->matches.size())) continue;
              motion = motion_of(matches, view, common);
              if (motion) best = Joined{*motion, std::move(matches)};
            }
          }
        }
      }
    }
  }
  return best;
}

struct Spheres {
  std::vector<Rigid3> part_from_view;
  std::vector<std::vector<Match>> matches;  // of each view
  std::vector<Eigen::Vector3d> common;
};

Result<Spheres> join_all(std::span<const View> views, double match_mm) {
  Spheres s;
  s.part_from_view.resize(views.size());
  s.matches.resize(views.size());
  s.common = views[0].spheres_mm;
  for (std::size_t j = 0; j < s.common.size(); ++j) s.matches[0].push_back({j, j});
  std::vector<bool> joined(views.size(), false);
  joined[0] = true;
  for (std::size_t round = 1; round < views.size(); ++round) {
    std::optional<Joined> best;
    std::size_t which = 0;
    for (std::size_t i = 0; i < views.size(); ++i) {
      if (joined[i]) continue;
      auto candidate = join(views[i].spheres_mm, s.common, match_mm);
      if (candidate && (!best || candidate->matches.size() > best->matches.size())) {
        best = std::move(candidate);
        which = i;
      }
    }
    if (!best) {
      std::string names;
      for (std::size_t i = 0; i < views.size(); ++i) {
        if (!joined[i]) names += (names.empty() ? "" : ", ") + views[i].name;
      }
      return unanswerable(
          fmt::format("{}: shares fewer than three reference spheres (not on a line) with the views "
                      "joined already; turn the object by less, or fix more spheres",
                      names));
    }
    joined[which] = true;
    s.part_from_view[which] = best->part_from_view;
    s.matches[which] = best->matches;
    for (std::size_t i = 0; i < views[which].spheres_mm.size(); ++i) {
      const bool known =
          std::any_of(best->matches.begin(), best->matches.end(), [&](const Match& m) { return m.view_sphere == i; });
      if (known) continue;
      s.matches[which].push_back({i, s.common.size()});
      s.common.push_back(best->part_from_view * views[which].spheres_mm[i]);
    }
  }
  return s;
}

/// X_j of eq. 1 for given motions.
void average_centres(std::span<const View> views, Spheres& s) {
  std::vector<Eigen::Vector3d> sum(s.common.size(), Eigen::Vector3d::Zero());
  std::vector<int> n(s.common.size(), 0);
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (const auto& m : s.matches[i]) {
      sum[m.common] += s.part_from_view[i] * views[i].spheres_mm[m.view_sphere];
      ++n[m.common];
    }
  }
  for (std::size_t j = 0; j < s.common.size(); ++j) s.common[j] = sum[j] / n[j];
}

/// Eq. 1, motions and centres by turns; the frame stays that of the first view.
void adjust_spheres(std::span<const View> views, Spheres& s) {
  for (int round = 0; round < 200; ++round) {
    average_centres(views, s);
    double moved = 0;
    for (std::size_t i = 1; i < views.size(); ++i) {
      const auto motion = motion_of(s.matches[i], views[i].spheres_mm, s.common);
      if (!motion) continue;
      moved = std::max(moved, (motion->translation_mm - s.part_from_view[i].translation_mm).norm());
      s.part_from_view[i] = *motion;
    }
    if (moved < 1e-9) break;
  }
  average_centres(views, s);
}

double sphere_rms(std::span<const View> views, const Spheres& s) {
  double sum = 0;
  int n = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (const auto& m : s.matches[i]) {
      sum += (s.part_from_view[i] * views[i].spheres_mm[m.view_sphere] - s.common[m.common]).squaredNorm();
      ++n;
    }
  }
  return std::sqrt(sum / n);
}

// ---- surface

/// Nearest points of one view, in its own frame. Points without a normal and grazing ones are left out.
class Surface {
 public:
  Surface(const View& view, double max_incidence_deg) : pupils_(view.pupils) {
    const double min_cosine = std::cos(max_incidence_deg * std::numbers::pi / 180);
    for (const auto& p : view.cloud.points) {
      if (!(p.normal.squaredNorm() > 0)) continue;
      const auto faces = [&](const Eigen::Vector3d& pupil) {
        return p.normal.dot((pupil - p.position_mm).normalized()) >= min_cosine;
      };
      if (!pupils_ || (faces(pupils_->camera_mm) && faces(pupils_->light_mm))) {
        points_.push_back(&p);
      } else {
        ++n_grazing_;
      }
    }
    tree_ = std::make_unique<Tree>(3, *this, nanoflann::KDTreeSingleIndexAdaptorParams(16));
    tree_->buildIndex();
  }
  Surface(const Surface&) = delete;
  Surface& operator=(const Surface&) = delete;

  std::size_t kdtree_get_point_count() const { return points_.size(); }
  double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return points_[i]->position_mm[static_cast<Eigen::Index>(axis)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }

  std::size_t size() const { return points_.size(); }
  std::size_t n_grazing() const { return n_grazing_; }
  const CloudPoint& at(std::size_t i) const { return *points_[i]; }
  /// Of a point, across a surface with that normal; where the camera is not known, along the normal.
  double u_across(const CloudPoint& p, const Eigen::Vector3d& normal) const {
    const double cosine = pupils_ ? std::abs(normal.dot((pupils_->camera_mm - p.position_mm).normalized())) : 1;
    return p.u_along_ray_mm * cosine;
  }

  struct Foot {
    Eigen::Vector3d point, normal;
    double u_mm;  // of the mean, across: the second part of eq. 3
  };
  /// q and n of eq. 2, in this view's frame.
  std::optional<Foot> foot_of(const Eigen::Vector3d& p, const RegistrationOptions& o) const {
    const auto k = static_cast<std::size_t>(o.neighbours);
    if (points_.size() < k) return std::nullopt;
    std::vector<std::size_t> index(k);
    std::vector<double> squared(k);
    tree_->knnSearch(p.data(), k, index.data(), squared.data());
    if (!(squared.front() <= o.max_pair_mm * o.max_pair_mm)) return std::nullopt;
    Foot out{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(), 0};
    for (const std::size_t i : index) {
      out.point += points_[i]->position_mm / static_cast<double>(k);
      out.normal += points_[i]->normal;
    }
    out.normal.normalize();
    // At a rim all neighbours lie to one side, and the plane would be extrapolated.
    const Eigen::Vector3d across = p - out.point - out.normal * out.normal.dot(p - out.point);
    if (!(across.squaredNorm() <= 0.25 * squared.back())) return std::nullopt;
    out.u_mm = u_across(*points_[index.front()], out.normal) / std::sqrt(static_cast<double>(k));
    return out;
  }

 private:
  using Tree =
      nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Surface>, Surface, 3, std::size_t>;
  std::optional<View::Pupils> pupils_;
  std::size_t n_grazing_ = 0;
  std::vector<const CloudPoint*> points_;
  std::unique_ptr<Tree> tree_;
};

struct Residual {
  double r, noise, u;       // eqs. 2 and 3; u is the noise, or 1 where the clouds have none
  Eigen::Vector3d x, y, n;  // T_a p, T_b q and the normal, in `part`
};

std::vector<Residual> residuals_of(const Surface& a, const Surface& b, const Rigid3& part_from_a,
                                   const Rigid3& part_from_b, const RegistrationOptions& o) {
  const Rigid3 b_from_a = part_from_b.inverse() * part_from_a;
  const std::size_t step = std::max<std::size_t>(1, a.size() / static_cast<std::size_t>(o.samples_per_view));
  std::vector<Residual> out;
  for (std::size_t i = 0; i < a.size(); i += step) {
    const CloudPoint& p = a.at(i);
    const auto foot = b.foot_of(b_from_a * p.position_mm, o);
    if (!foot) continue;
    const Eigen::Vector3d n = part_from_b.rotation * foot->normal;
    if (!(n.dot(part_from_a.rotation * p.normal) >= std::sqrt(0.5))) continue;
    const Eigen::Vector3d x = part_from_a * p.position_mm, y = part_from_b * foot->point;
    const double noise = std::hypot(a.u_across(p, part_from_a.rotation.inverse() * n), foot->u_mm);  // eq. 3
    out.push_back({n.dot(x - y), noise, noise > 0 ? noise : 1.0, x, y, n});
  }
  return out;
}

/// 1.4826 times the median size: about zero, where the views meet.
double robust_sd(std::vector<double> values) {
  for (double& v : values) v = std::abs(v);
  return 1.4826 * median(std::move(values));
}

double tukey(double z) {
  const double q = 1 - z * z / (kTukey * kTukey);
  return q > 0 ? q * q : 0;
}

struct ViewPair {
  std::size_t a, b;
  std::vector<Residual> residuals;
};

/// Views that overlap stay the same: those that do not are left out after the first search.
void search(const std::vector<std::unique_ptr<Surface>>& surfaces, const std::vector<Rigid3>& motions,
            const RegistrationOptions& o, std::vector<ViewPair>& pairs) {
  parallel_for(static_cast<int>(pairs.size()), [&](int k) {
    auto& pair = pairs[static_cast<std::size_t>(k)];
    pair.residuals = residuals_of(*surfaces[pair.a], *surfaces[pair.b], motions[pair.a], motions[pair.b], o);
  });
  std::erase_if(pairs, [](const ViewPair& p) { return p.residuals.size() < kMinPairs; });
}

double scale_of(const std::vector<ViewPair>& pairs) {
  std::vector<double> all;
  for (const auto& pair : pairs) {
    for (const auto& r : pair.residuals) all.push_back(r.r / r.u);
  }
  return all.empty() ? 0 : robust_sd(std::move(all));
}

/// One Gauss-Newton step of eq. 2; x -> x + w x x + t in `part` for each view but the first. Returns the largest move.
double refine_once(std::span<const View> views, const std::vector<ViewPair>& pairs, double s, double s_c,
                   Spheres& spheres) {
  const auto n = static_cast<Eigen::Index>(6 * (views.size() - 1));
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
  using Row = Eigen::Matrix<double, 6, 1>;
  const auto add = [&](std::size_t view, const Row& row, std::size_t other, const Row& other_row, double r, double w) {
    const auto at = [](std::size_t v) { return static_cast<Eigen::Index>(6 * (v - 1)); };
    for (const auto& [v, j] : {std::pair(view, &row), std::pair(other, &other_row)}) {
      if (v == 0) continue;
      right.segment<6>(at(v)) -= w * r * *j;
      normal.block<6, 6>(at(v), at(v)) += w * *j * j->transpose();
    }
    if (view != 0 && other != 0) {
      normal.block<6, 6>(at(view), at(other)) += w * row * other_row.transpose();
      normal.block<6, 6>(at(other), at(view)) += w * other_row * row.transpose();
    }
  };
  for (const auto& pair : pairs) {
    for (const auto& r : pair.residuals) {
      const double w = tukey(r.r / (s * r.u)) / (s * s * r.u * r.u);
      if (!(w > 0)) continue;
      Row row_a, row_b;
      row_a << r.x.cross(r.n), r.n;
      row_b << -r.y.cross(r.n), -r.n;
      add(pair.a, row_a, pair.b, row_b, r.r, w);
    }
  }
  for (std::size_t i = 1; i < views.size(); ++i) {
    for (const auto& m : spheres.matches[i]) {
      const Eigen::Vector3d x = spheres.part_from_view[i] * views[i].spheres_mm[m.view_sphere];
      for (int axis = 0; axis < 3; ++axis) {
        const Eigen::Vector3d e = Eigen::Vector3d::Unit(axis);
        Row row;
        row << x.cross(e), e;
        add(i, row, 0, Row::Zero(), (x - spheres.common[m.common])[axis], 1 / (s_c * s_c));
      }
    }
  }
  const Eigen::VectorXd step = normal.ldlt().solve(right);
  double moved = 0;
  for (std::size_t i = 1; i < views.size(); ++i) {
    const auto part = step.segment<6>(static_cast<Eigen::Index>(6 * (i - 1)));
    const Eigen::Vector3d w = part.head<3>(), t = part.tail<3>();
    const double angle = w.norm();
    const Eigen::Quaterniond turn(angle > 0 ? Eigen::AngleAxisd(angle, w / angle) : Eigen::AngleAxisd::Identity());
    spheres.part_from_view[i] = Rigid3{turn, t} * spheres.part_from_view[i];
    spheres.part_from_view[i].rotation.normalize();
    moved = std::max(moved, t.norm() + angle * 100);  // 100 mm: the object's size, so that an angle counts as a length
  }
  average_centres(views, spheres);
  return moved;
}

void describe(const std::vector<ViewPair>& pairs, double s, Registration& out) {
  for (const auto& pair : pairs) {
    PairResiduals p{.a = pair.a, .b = pair.b};
    double squares = 0, noise = 0;
    for (const auto& r : pair.residuals) {
      if (!(tukey(r.r / (s * r.u)) > 0)) continue;
      ++p.n_points;
      p.mean_mm += r.r;
      squares += r.r * r.r;
      noise += r.noise * r.noise;
    }
    if (p.n_points < kMinPairs) continue;
    const auto n = static_cast<double>(p.n_points);
    p.mean_mm /= n;
    p.sd_mm = std::sqrt(std::max(0.0, (squares - n * p.mean_mm * p.mean_mm) / (n - 1)));
    p.noise_mm = std::sqrt(noise / n);
    out.pairs.push_back(p);
  }
  for (const auto& p : out.pairs) {
    out.mean_deviation_mm += std::abs(p.mean_mm) / static_cast<double>(out.pairs.size());
    out.mean_sd_mm += p.sd_mm / static_cast<double>(out.pairs.size());
    out.mean_noise_mm += p.noise_mm / static_cast<double>(out.pairs.size());
  }
}

}  // namespace

Result<Registration> register_views(std::span<const View> views, const RegistrationOptions& options) {
  require(views.size() >= 2, "a registration needs at least two views");
  for (const auto& view : views) {
    if (view.spheres_mm.size() < 3) {
      return unanswerable(fmt::format("{}: {} reference spheres were found in it; three are needed", view.name,
                                      view.spheres_mm.size()));
    }
  }
  auto spheres = join_all(views, options.match_mm);
  if (!spheres) return tl::unexpected(spheres.error());
  adjust_spheres(views, *spheres);
  Registration out;
  std::vector<std::unique_ptr<Surface>> surfaces;
  for (const auto& view : views) {
    surfaces.push_back(std::make_unique<Surface>(view, options.max_incidence_deg));
    out.n_grazing.push_back(surfaces.back()->n_grazing());
  }
  std::vector<ViewPair> pairs;
  for (std::size_t a = 0; a < views.size(); ++a) {
    for (std::size_t b = 0; b < views.size(); ++b) {
      if (a != b) pairs.push_back({a, b, {}});
    }
  }
  search(surfaces, spheres->part_from_view, options, pairs);
  double s = scale_of(pairs);
  if (options.refine && s > 0) {
    // The centres' own agreement, but never so small that they would outvote the surface by rounding.
    const double s_c = std::max(sphere_rms(views, *spheres), 1e-3);
    for (out.iterations = 1; out.iterations <= options.max_iterations; ++out.iterations) {
      const double moved = refine_once(views, pairs, s, s_c, *spheres);
      search(surfaces, spheres->part_from_view, options, pairs);
      s = scale_of(pairs);
      if (moved < 1e-4) break;
    }
  }
  if (s > 0) describe(pairs, s, out);
  out.part_from_view = spheres->part_from_view;
  out.spheres_mm = spheres->common;
  out.sphere_rms_mm = sphere_rms(views, *spheres);
  return out;
}

PointCloud merged(std::span<const View> views, const Registration& registration) {
  PointCloud out;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Rigid3& motion = registration.part_from_view[i];
    for (CloudPoint p : views[i].cloud.points) {
      p.position_mm = motion * p.position_mm;
      p.normal = motion.rotation * p.normal;
      out.points.push_back(p);
    }
  }
  return out;
}

}  // namespace fringecal::metrology
