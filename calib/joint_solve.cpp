#include "calib/joint_solve.h"

#include "calib/bundle_rows.h"
#include "core/error.h"
#include "core/statistics.h"

#include <Eigen/Cholesky>
#include <boost/math/distributions/chi_squared.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace fringecal::calib {
namespace {

constexpr double kRejectBeyond = 4.0;  // standard deviations: 6e-5 of good components, calibrate.h
constexpr double kTakeBackBelow = 0.9;
// A relief or bend below this share of its start (1e-4 of the board's diagonal) is a micrometre: taken for none.
constexpr double kAbsent = 0.03;
// Readings better than a thousandth of what they state are taken for a thousandth: without a floor, readings without
// any error would drown the priors in rounding. The same holds for what scatters from capture to capture.
constexpr double kLeastScale = 1e-3;

constexpr double kByChance = 1e-3;  // eq. 4
constexpr std::size_t kGroups = 3;
std::size_t index_of(Group group) { return static_cast<std::size_t>(group); }
Group group_of(const Sight& s, std::size_t row) {
  return row < 2 ? Group::camera : s.target == kOnFlat ? Group::flat : Group::projector;
}

/// Of row k of a sight.
double standard_deviation(const Sight& s, std::size_t k, const Components& c) {
  if (k < 2) return s.u_pixel_px * c.camera;
  return (k == 2 ? s.x->u : s.y->u) * (s.target == kOnFlat ? c.flat : c.projector);
}

/// Every reading of the sights in use, or of those left out, whitened; no value where a point in use is not in front of
/// a lens.
std::optional<std::vector<Reading>> readings_of(const Bundle& b, const Components& c, bool in_use) {
  const auto shapes = rows::bow_shapes(b);
  std::vector<rows::Frame> frames;
  for (std::size_t j = 0; j < b.cam_from_board.size(); ++j) frames.push_back(rows::frame_of(b, j));
  std::vector<Reading> out;
  rows::SightRows r;
  for (std::size_t i = 0; i < b.sights.size(); ++i) {
    const Sight& s = b.sights[i];
    if (s.used != in_use) continue;
    if (!rows::evaluate(b, frames[static_cast<std::size_t>(s.pose)], shapes[rows::shape_index(b, s)], s,
                        rows::With::residuals, r)) {
      if (in_use) return std::nullopt;
      continue;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      if (!r.has[k]) continue;
      const double whitened = r.row[k].residual / standard_deviation(s, k, c);
      if (!std::isfinite(whitened)) return std::nullopt;
      out.push_back({i, group_of(s, k), whitened, 0.0});
    }
  }
  return out;
}

/// 1.4826 MAD about zero of each group, in units of the whitening.
std::array<double, kGroups> robust_scales(const std::vector<Reading>& readings) {
  std::array<std::vector<double>, kGroups> sizes;
  for (const Reading& r : readings) sizes[index_of(r.group)].push_back(std::abs(r.residual));
  std::array<double, kGroups> out{1.0, 1.0, 1.0};
  for (std::size_t g = 0; g < kGroups; ++g) {
    if (!sizes[g].empty()) out[g] = std::max(1.4826 * median(std::move(sizes[g])), 1e-9);
  }
  return out;
}

/// Leaves out the sights with a component beyond the limit and takes back those that are within it again (`without`: the
/// readings of sights that were left out); returns how many changed. The standard deviation is the larger of the whole
/// group's (`scale`, in units of the whitening) and of the sight's own pose, robustly: a pose that fits worse as a whole
/// is no reason to keep only those of its corners that happen to fit.
int reject(Bundle& bundle, const std::vector<Reading>& readings, const std::vector<Reading>& without,
           const std::array<double, kGroups>& scale) {
  const auto size_of = [&](const Reading& r) {
    return std::abs(r.residual) / (scale[index_of(r.group)] * std::sqrt(std::max(1.0 - r.leverage, 0.05)));
  };
  const auto slot = [&](const Reading& r) {
    return kGroups * static_cast<std::size_t>(bundle.sights[r.sight].pose) + index_of(r.group);
  };
  std::vector<std::vector<double>> sizes(kGroups * bundle.cam_from_board.size());
  for (const Reading& r : readings) sizes[slot(r)].push_back(size_of(r));
  std::vector<double> limit;
  limit.reserve(sizes.size());
  for (auto& s : sizes) {
    limit.push_back(kRejectBeyond * (s.empty() ? 1.0 : std::max(1.0, 1.4826 * median(std::move(s)))));
  }
  int count = 0;
  for (const Reading& r : readings) {
    Sight& sight = bundle.sights[r.sight];
    if (sight.used && size_of(r) > limit[slot(r)]) {
      sight.used = false;
      ++count;
    }
  }
  std::vector<std::size_t> back;
  for (std::size_t i = 0; i < without.size();) {
    const std::size_t first = i, sight = without[i].sight;
    bool fits = true;
    // A margin keeps a sight on the limit from going out and in.
    for (; i < without.size() && without[i].sight == sight; ++i) {
      fits = fits && size_of(without[i]) < kTakeBackBelow * limit[slot(without[i])];
    }
    if (fits && i > first) back.push_back(sight);
  }
  for (const std::size_t sight : back) bundle.sights[sight].used = true;
  return count + static_cast<int>(back.size());
}

/// What a parameter's standard uncertainty moves at the edge of what the lenses see, mm: angle there times distance.
double at_the_edge_mm(const std::string& name, double u, const Bundle& b) {
  const double f = b.camera.fx_px, edge = 0.5 * std::hypot(b.camera.width_px, b.camera.height_px) / f;
  double distance = 0;
  for (const auto& pose : b.cam_from_board) distance += pose.translation_mm.norm();
  distance /= static_cast<double>(b.cam_from_board.size());
  const auto ends = [&](const char* with) { return name.ends_with(with); };
  const auto& axis = b.projector && b.projector->x ? b.projector->x : b.projector ? b.projector->y : std::nullopt;
  double angle = 0;
  if (ends("fx_px") || ends("fy_px")) angle = u / f * edge;
  if (ends("cx_px") || ends("cy_px")) angle = u / f;
  if (ends(".f") && axis) angle = u / std::abs(axis->f) * edge;
  if (ends(".u0") && axis) angle = u / std::abs(axis->f);
  if (ends("k1")) angle = u * std::pow(edge, 3);
  if (ends("k2")) angle = u * std::pow(edge, 5);
  if (ends("k3")) angle = u * std::pow(edge, 7);
  if (ends("p1") || ends("p2")) angle = 3.0 * u * edge * edge;
  if (ends("_rad")) angle = u;
  return name.starts_with("proj_from_cam.translation") ? u : angle * distance;
}

/// Parameters by what they leave open at the edge, the most first, down to a tenth of it; focal lengths down to a
/// millimetre, because a board turned otherwise is what they ask for.
std::string open_words(const std::vector<std::string>& names, const Eigen::VectorXd& u, const Bundle& bundle) {
  std::vector<std::pair<double, std::string>> sizes;
  for (std::size_t i = 0; i < names.size(); ++i) {
    sizes.emplace_back(at_the_edge_mm(names[i], u[static_cast<Eigen::Index>(i)], bundle), names[i]);
  }
  std::stable_sort(sizes.begin(), sizes.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::string words;
  for (const auto& [mm, name] : sizes) {
    const bool focal = name.ends_with("fx_px") || name.ends_with("fy_px") || name.ends_with(".f");
    if (!(mm >= 0.1 * sizes.front().first || (focal && mm > 1.0))) continue;
    words += fmt::format("{}{} ({:.2g} mm at the edge)", words.empty() ? "" : ", ", name, mm);
  }
  return words;
}

Unanswerable no_explanation() {
  return {
      "the joint solve found no camera and projector that explain the corners; look for a pose with a wrong board, a "
      "moved board or a moved scanner"};
}

class Solver {
 public:
  Solver(Bundle& bundle, const SolveSettings& settings)
      : bundle_(bundle), settings_(settings), components_(settings.components) {
    const auto zeros = [&](auto& list, std::size_t n) { list.resize(n, std::decay_t<decltype(list[0])>::Zero()); };
    zeros(bundle.print_mm, bundle.targets_mm.size());
    zeros(bundle.bend_mm, bundle.cam_from_board.size());
    zeros(bundle.phase_offset, bundle.cam_from_board.size());
    rows::set_slopes(bundle);
  }

  Result<SolveReport> run();

 private:
  BundleSystem system(double loss) const { return {bundle_, settings_.free, components_, loss}; }
  bool minimise(double loss, double decrement2, double lambda);
  bool robust_passes();
  /// Eq. 2 for one pass; true where nothing changed by as much as matters.
  Result<bool> update_components(const BundleSystem::Posterior& posterior);
  Result<SolveReport> report(const BundleSystem& system, BundleSystem::Posterior posterior);
  Result<Eigen::MatrixXd> with_known_components(const BundleSystem::Posterior& posterior) const;
  Eigen::MatrixXd over_the_place_along(const BundleSystem& system, const Eigen::MatrixXd& linear) const;
  void check_poses(const BundleSystem& system, const BundleSystem::Posterior& posterior, SolveReport& report) const;

  Bundle& bundle_;
  const SolveSettings& settings_;
  Components components_;
  std::array<double, kGroups> least_{0.0, 0.0, 0.0};  // the robust passes' scales
  std::array<double, kGroups> judged_{1.0, 1.0,
                                      1.0};  // scales by which corners are rejected, in units of the whitening
  int iterations_ = 0;
};

/// Levenberg-Marquardt from the bundle until the Newton decrement is below the limit. Where the residuals' own curvature is
/// as large as that of the normal equations (along the fringes), a whole step overshoots to the other side of the minimum,
/// lowers the cost a little and is followed by one back, thousands of times. So the length of each step d is set by the
/// slope at its end,
///   t = d2 / (d2 + g(1) . d),   d2 = -g(0) . d, the squared decrement                                            (5)
/// where the slope, linear between the ends, is zero. The cost could not do this: near the minimum it drowns in rounding.
bool Solver::minimise(double loss, double decrement2, double lambda) {
  BundleSystem here = system(loss);
  double cost = here.cost(bundle_);
  if (!std::isfinite(cost) || !here.linearise(bundle_)) return false;
  constexpr int kIterations = 200;
  for (int iteration = 0; iteration < kIterations; ++iteration, ++iterations_) {
    while (true) {
      // The rounding of a sum of squares: below it a step can no longer be judged by its cost.
      const double limit = cost * (1.0 + 1e-13);
      const auto step = here.newton(lambda);
      const double d2 = step ? -here.slope(*step) : HUGE_VAL;
      BundleSystem there = system(loss);
      bool lower = false;
      if (step) {
        Bundle next = there.moved(bundle_, *step, 1.0);
        double next_cost = there.cost(next);
        bool usable = std::isfinite(next_cost) && there.linearise(next);
        const double length = usable ? d2 / std::max(d2 + there.slope(*step), 1e-300) : 1.0;  // eq. 5
        if (length < 0.8 || length > 1.25) {
          Bundle other = there.moved(bundle_, *step, std::clamp(length, 0.05, 10.0));
          const double other_cost = there.cost(other);
          if (other_cost <= std::max(next_cost, limit)) {
            next = std::move(other);
            next_cost = other_cost;
            usable = there.linearise(next);
          }
        }
        lower = usable && next_cost <= limit;
        if (lower) {
          bundle_ = std::move(next);
          cost = next_cost;
        }
      }
      if (lower) {
        here = std::move(there);
        lambda = lambda < 1e-9 ? 0.0 : 0.1 * lambda;
        if (d2 < decrement2 && lambda < 1e-4) return true;
        break;
      }
      if (d2 < decrement2) return true;
      lambda = std::max(10.0 * lambda, 1e-6);
      if (lambda > 1e10) return std::isfinite(cost);
    }
  }
  return true;
}

bool Solver::robust_passes() {
  // The scale of the loss comes from the residuals themselves; it starts wide, at the start's own misfit.
  const auto rescale = [&] {
    const auto now = readings_of(bundle_, components_, true);
    if (!now) return false;
    const auto spread = robust_scales(*now);
    components_.camera = std::max(components_.camera * spread[0], kLeastScale);
    components_.projector = std::max(components_.projector * spread[1], kLeastScale);
    components_.flat = std::max(components_.flat * spread[2], kLeastScale);
    return true;
  };
  for (int pass = 0; pass < 3; ++pass) {
    if (!rescale() || !minimise(2.0, 1e-3, pass == 0 ? 1e-3 : 0.0)) return false;
    rows::set_slopes(bundle_);
  }
  if (!rescale()) return false;
  least_ = {components_.camera, components_.projector, components_.flat};
  const auto whitened = readings_of(bundle_, components_, true);
  if (!whitened) return false;
  reject(bundle_, *whitened, {}, {1.0, 1.0, 1.0});
  return true;
}

Result<bool> Solver::update_components(const BundleSystem::Posterior& posterior) {
  std::array<double, kGroups> chi2{}, redundancy{}, count{};
  for (const Reading& r : posterior.readings) {
    const std::size_t g = index_of(r.group);
    chi2[g] += r.residual * r.residual;
    redundancy[g] += 1.0 - r.leverage;
    count[g] += 1;
  }
  bool settled = true;
  double* const scales[] = {&components_.camera, &components_.projector, &components_.flat};
  constexpr std::array<const char*, kGroups> kNames = {"camera", "projector", "flat's"};
  for (std::size_t g = 0; g < kGroups; ++g) {
    if (!(count[g] > 0)) continue;
    if (!(redundancy[g] >= 3.0)) {
      return unanswerable(fmt::format("{:.0f} {} readings leave {:.1f} degrees of freedom; capture more poses",
                                      count[g], kNames[g], redundancy[g]));
    }
    const double factor = std::sqrt(chi2[g] / redundancy[g]);  // eq. 2
    const double next = std::max(*scales[g] * factor, kLeastScale);
    settled = settled && std::abs(next - *scales[g]) < 1e-3 * *scales[g];
    judged_[g] = std::max(factor, least_[g] / *scales[g]);
    *scales[g] = next;
  }
  const auto update = [&](double& sd, const Scatter& scatter, double start) {
    // Where the readings say next to nothing about the single values, their scatter is no source for the standard
    // deviation either: it stays.
    if (!(sd > 0) || !(scatter.redundancy > 1e-3 * scatter.count)) return;
    const double factor = std::sqrt(std::max(scatter.squares, 0.0) / scatter.redundancy);  // eq. 2
    const double next = std::max(sd * factor, kLeastScale * start);
    // A component that explains little is known badly, and matters as little.
    settled = settled && std::abs(next - sd) * scatter.redundancy < 5e-3 * sd * scatter.count;
    sd = next;
  };
  update(components_.print_mm, posterior.print, settings_.components.print_mm);
  update(components_.relief_mm, posterior.relief, settings_.components.relief_mm);
  update(components_.bend_mm, posterior.bend, settings_.components.bend_mm);
  update(components_.phase_offset, posterior.phase_offset, settings_.components.phase_offset);
  // What the views have shown to be absent need not be solved for.
  if (components_.relief_mm > 0 && components_.relief_mm < kAbsent * settings_.components.relief_mm) {
    components_.relief_mm = 0;
    for (auto& e : bundle_.print_mm) e.z() = 0;
  }
  if (components_.bend_mm > 0 && components_.bend_mm < kAbsent * settings_.components.bend_mm) {
    components_.bend_mm = 0;
    for (auto& c : bundle_.bend_mm) c.setZero();
  }
  return settled;
}

Result<SolveReport> Solver::run() {
  const bool may_reject = !settings_.fixed_components && settings_.outliers == Outliers::reject;
  if (may_reject && !robust_passes()) return tl::unexpected(no_explanation());
  // Clean passes: solve, variance components, outliers against them, until nothing changes.
  constexpr int kPasses = 30, kTakeBackPasses = 10;
  bool settled = false;
  for (int pass = 0;; ++pass) {
    const bool last = settled || pass == kPasses || settings_.fixed_components;
    // After the robust passes the start is next to the solution: undamped steps, which the weakly determined place along
    // the fringes needs.
    if (!minimise(0.0, last ? 1e-16 : 1e-6, may_reject || pass > 0 ? 0.0 : 1e-3)) {
      return tl::unexpected(no_explanation());
    }
    BundleSystem s = system(0.0);
    if (!s.linearise(bundle_)) return tl::unexpected(no_explanation());
    auto posterior = s.posterior(bundle_);
    if (!posterior) return tl::unexpected(posterior.error());
    if (last) return report(s, std::move(*posterior));
    const auto same = update_components(*posterior);
    if (!same) return tl::unexpected(same.error());
    int changed = 0;
    if (may_reject) {
      const auto without = readings_of(bundle_, components_, false);
      changed =
          reject(bundle_, posterior->readings, pass < kTakeBackPasses ? *without : std::vector<Reading>(), judged_);
    }
    settled = *same && changed == 0;
    rows::set_slopes(bundle_);
  }
}

Result<SolveReport> Solver::report(const BundleSystem& system, BundleSystem::Posterior posterior) {
  SolveReport out;
  const auto left = system.newton(0.0);
  out.newton_decrement = left ? std::sqrt(std::max(0.0, -system.slope(*left))) : HUGE_VAL;
  if (!(out.newton_decrement < 1e-3)) {  // eq. 3
    // What is left is along what the poses hardly determine.
    const auto n = static_cast<Eigen::Index>(system.names().size());
    const Eigen::VectorXd u = posterior.shared.diagonal().head(n).cwiseMax(0.0).cwiseSqrt();
    const std::string open = open_words(system.names(), u, bundle_);
    return unanswerable(
        fmt::format("the joint solve did not converge: {:.2g} standard uncertainties are left to go after {} "
                    "iterations; the poses leave open {}; capture the board in more poses, tilted by 20 to 40 degrees "
                    "about different axes",
                    out.newton_decrement, iterations_, open));
  }
  const int reported = system.reported();
  out.covariance.names.assign(system.names().begin(), system.names().begin() + reported);
  auto covariance = with_known_components(posterior);
  if (!covariance) return tl::unexpected(covariance.error());
  out.covariance.covariance = covariance->topLeftCorner(reported, reported);
  if (system.along_column() >= 0 && !settings_.fixed_components) {
    out.covariance.covariance = over_the_place_along(system, out.covariance.covariance);
  }
  if (reported > 0 && !(out.covariance.covariance.diagonal().minCoeff() > 0.0)) {
    return unanswerable("the covariance of the calibration is not positive; capture more poses");
  }
  if (settings_.pose_check == PoseCheck::yes) check_poses(system, posterior, out);
  out.components = components_;
  out.chi2 = system.cost(bundle_);
  double squares[kGroups] = {}, redundancy = 0, chi2 = 0;
  int count[kGroups] = {};
  for (const Reading& r : posterior.readings) {
    const Sight& s = bundle_.sights[r.sight];
    const bool camera = r.group == Group::camera, x = bundle_.projector && bundle_.projector->x && s.x;
    const double sd = standard_deviation(s, camera ? 0 : x ? 2 : 3, components_);
    squares[index_of(r.group)] += std::pow(r.residual * sd, 2);
    ++count[index_of(r.group)];
    redundancy += 1.0 - r.leverage;
    chi2 += r.residual * r.residual;
  }
  out.camera_rms_px = std::sqrt(squares[0] / std::max(1, count[0]));
  out.projector_rms = std::sqrt(squares[1] / std::max(1, count[1]));
  out.flat_rms = std::sqrt(squares[2] / std::max(1, count[2]));
  out.chi2_per_dof = chi2 / std::max(redundancy, 1.0);
  out.residuals = count[0] + count[1] + count[2];
  out.parameters = system.lens_and_pose_unknowns();
  for (const Sight& s : bundle_.sights) out.n_rejected += s.used ? 0 : 1;
  out.iterations = iterations_;
  return out;
}

/// C_ss with every variance component s^2 from r degrees of freedom taken as s^2 r / (r - 2): the variance of what is known
/// to have scattered that much [JCGM101, 6.4.9.2].
Result<Eigen::MatrixXd> Solver::with_known_components(const BundleSystem::Posterior& posterior) const {
  Components known = components_;
  const auto widen = [](double& sd, const Scatter& scatter) {
    // Below four degrees of freedom the factor says no more than that little is known.
    const double r = std::max(scatter.redundancy, 4.0);
    if (sd > 0) sd *= std::sqrt(r / (r - 2.0));
  };
  widen(known.print_mm, posterior.print);
  widen(known.relief_mm, posterior.relief);
  widen(known.bend_mm, posterior.bend);
  widen(known.phase_offset, posterior.phase_offset);
  BundleSystem system(bundle_, settings_.free, known);
  if (!system.linearise(bundle_)) return tl::unexpected(no_explanation());
  auto widened = system.posterior(bundle_);
  if (!widened) return tl::unexpected(widened.error());
  return std::move(widened->shared);
}

Eigen::MatrixXd Solver::over_the_place_along(const BundleSystem& system, const Eigen::MatrixXd& linear) const {
  const Eigen::Index n = linear.rows(), at = system.along_column();
  const int along = bundle_.projector->x ? 1 : 0;
  const double here = bundle_.proj_from_cam.translation_mm[along], u = std::sqrt(linear(at, at));
  SolveSettings held{.free = settings_.free, .components = components_, .fixed_components = true};
  held.components.along_mm = 0;
  Eigen::MatrixXd moves = Eigen::MatrixXd::Zero(n, n), widest;
  double weights = 0, least = 0, first = 0, largest = 0;
  for (const double z : {0.0, -std::sqrt(3.0), std::sqrt(3.0)}) {
    Bundle there = bundle_;
    there.proj_from_cam.translation_mm[along] = here + z * u;
    const auto report = solve_bundle(there, held);
    if (!report) continue;  // a place that no scanner explains has no weight
    const double cost = report->chi2 + std::pow((here + z * u) / components_.along_mm, 2);
    const Eigen::MatrixXd& rest = report->covariance.covariance;
    // Half the logarithm of the determinant.
    const double volume = Eigen::LLT<Eigen::MatrixXd>(rest).matrixLLT().diagonal().array().log().sum();
    if (widest.size() == 0) {
      least = cost;
      first = volume;
    }
    if (widest.size() == 0 || volume > largest) {
      largest = volume;
      widest = rest;
    }
    const double weight =
        (z == 0 ? 2.0 / 3.0 : 1.0 / 6.0) * std::exp(0.5 * (z * z - (cost - least)) + (volume - first));
    const Eigen::VectorXd d = system.difference(bundle_, there);
    weights += weight;
    moves += weight * d * d.transpose();
  }
  if (!(weights > 0)) return linear;
  Eigen::MatrixXd out = moves / weights;  // eq. 6
  const Eigen::Index after = n - at - 1;
  out.topLeftCorner(at, at) += widest.topLeftCorner(at, at);
  out.topRightCorner(at, after) += widest.topRightCorner(at, after);
  out.bottomLeftCorner(after, at) += widest.bottomLeftCorner(after, at);
  out.bottomRightCorner(after, after) += widest.bottomRightCorner(after, after);
  return out;
}

void Solver::check_poses(const BundleSystem& system, const BundleSystem::Posterior& posterior, SolveReport& out) const {
  const double n = static_cast<double>(bundle_.cam_from_board.size()) - bundle_.flats;
  // Without one of three poses the rest seldom determine anything; with them alone there is no scatter to judge by.
  if (n < 4) return;
  Eigen::MatrixXd& covariance = out.covariance.covariance;
  const auto found = system.pose_scatter(bundle_, posterior.shared.diagonal().head(covariance.rows()));
  if (!found) return;
  out.pose_scatter = found->ratio;
  const boost::math::chi_squared chi2(found->ways);
  out.pose_scatter_limit =
      found->expected * boost::math::quantile(boost::math::complement(chi2, kByChance)) / found->ways;
  if (!(out.pose_scatter > out.pose_scatter_limit)) return;
  out.widened = std::sqrt(out.pose_scatter * (n - 1.0) / std::max(n - 3.0, 1.0));
  covariance *= out.widened * out.widened;
}

}  // namespace

int term_count(DistortionTerms terms) {
  switch (terms) {
    case DistortionTerms::none:
      return 0;
    case DistortionTerms::radial:
      return 2;
    case DistortionTerms::radial_tangential:
      return 4;
    case DistortionTerms::full:
      return 5;
    case DistortionTerms::automatic:
      break;
  }
  throw std::logic_error("broken contract: 'automatic' is resolved before terms are counted");
}

const char* name_of(DistortionTerms terms) {
  switch (terms) {
    case DistortionTerms::none:
      return "none";
    case DistortionTerms::radial:
      return "radial";
    case DistortionTerms::radial_tangential:
      return "radial+tangential";
    case DistortionTerms::full:
      return "full";
    case DistortionTerms::automatic:
      return "auto";
  }
  return "";
}

Result<SolveReport> solve_bundle(Bundle& bundle, const SolveSettings& settings) {
  require(!bundle.targets_mm.empty() && !bundle.sights.empty(), "a bundle has targets and sights");
  return Solver(bundle, settings).run();
}

}  // namespace fringecal::calib
