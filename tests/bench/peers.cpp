#include "tests/bench/peers.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/linear_least_squares_fitting_3.h>
#include <ceres/ceres.h>
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <random>
#include <sstream>

#ifdef FRINGECAL_HAVE_PCL
#include <pcl/sample_consensus/ransac.h>
#include <pcl/sample_consensus/sac_model_cylinder.h>
#include <pcl/sample_consensus/sac_model_plane.h>
#include <pcl/sample_consensus/sac_model_sphere.h>
#include <pcl/sample_consensus/impl/ransac.hpp>
#include <pcl/sample_consensus/impl/sac_model_cylinder.hpp>
#include <pcl/sample_consensus/impl/sac_model_plane.hpp>
#include <pcl/sample_consensus/impl/sac_model_sphere.hpp>
#endif

namespace fringecal::bench {
namespace {

constexpr double kNoise_mm = 0.03;

struct SphereResidual {
  Eigen::Vector3d p;
  template <class T>
  bool operator()(const T* s, T* d) const {
    const Eigen::Matrix<T, 3, 1> u(p.x() - s[0], p.y() - s[1], p.z() - s[2]);
    d[0] = u.norm() - s[3];
    return true;
  }
};
struct CylinderResidual {  // a point of the axis in z = const, two slopes, the radius
  Eigen::Vector3d p;
  int along;
  template <class T>
  bool operator()(const T* s, T* d) const {
    const int i = (along + 1) % 3, j = (along + 2) % 3;
    Eigen::Matrix<T, 3, 1> u, a;
    u[i] = p[i] - s[0];
    u[j] = p[j] - s[1];
    u[along] = T(p[along]);
    a[i] = s[2];
    a[j] = s[3];
    a[along] = T(1.0);
    d[0] = u.cross(a).norm() / a.norm() - s[4];
    return true;
  }
};

void solve(ceres::Problem& problem) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;  // its fastest for few parameters
  options.num_threads = 1;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-12;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
}

Answer by_ceres(Shape shape, const Cloud& cloud, const Answer& start, bool has_outliers) {
  ceres::Problem::Options owner;
  owner.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(owner);
  ceres::CauchyLoss cauchy(3.0 * kNoise_mm);
  ceres::LossFunction* loss = has_outliers ? &cauchy : nullptr;
  if (shape == Shape::sphere) {
    double s[4] = {start.place.x(), start.place.y(), start.place.z(), start.radius};
    for (const auto& p : cloud) {
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<SphereResidual, 1, 4>(new SphereResidual{p}), loss, s);
    }
    solve(problem);
    return {{s[0], s[1], s[2]}, {}, s[3]};
  }
  const int along = 1, i = 2, j = 0;
  const Eigen::Vector3d a = start.direction / start.direction[along];
  const Eigen::Vector3d at = start.place - start.place[along] * a;
  double s[5] = {at[i], at[j], a[i], a[j], start.radius};
  for (const auto& p : cloud) {
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<CylinderResidual, 1, 5>(new CylinderResidual{p, along}),
                             loss, s);
  }
  solve(problem);
  Answer out;
  out.place[i] = s[0];
  out.place[j] = s[1];
  out.place[along] = 0;
  out.direction[i] = s[2];
  out.direction[j] = s[3];
  out.direction[along] = 1;
  out.direction.normalize();
  out.radius = s[4];
  return out;
}

Answer plane_by_cgal(const Cloud& cloud, const Answer&) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  // The points as CGAL wants them; the copy is not counted by the caller's repeats after the first.
  static std::vector<Kernel::Point_3> points;
  static const void* of = nullptr;
  if (of != cloud.data() || points.size() != cloud.size()) {
    points.clear();
    for (const auto& p : cloud) points.emplace_back(p.x(), p.y(), p.z());
    of = cloud.data();
  }
  Kernel::Plane_3 plane;
  Kernel::Point_3 centroid;
  CGAL::linear_least_squares_fitting_3(points.begin(), points.end(), plane, centroid, CGAL::Dimension_tag<0>());
  const auto n = plane.orthogonal_vector();
  return {{centroid.x(), centroid.y(), centroid.z()}, Eigen::Vector3d(n.x(), n.y(), n.z()).normalized(), 0};
}

#ifdef FRINGECAL_HAVE_PCL
struct PclCloud {
  pcl::PointCloud<pcl::PointXYZ>::Ptr points{new pcl::PointCloud<pcl::PointXYZ>};
  pcl::PointCloud<pcl::Normal>::Ptr normals{new pcl::PointCloud<pcl::Normal>};
};

/// PCL's own form of the points, made once per cloud. Its cylinder wants normals: the true ones.
const PclCloud& as_pcl(Shape shape, const Cloud& cloud) {
  static PclCloud out;
  static const void* of = nullptr;
  static Shape of_shape = Shape::plane;
  if (of == cloud.data() && of_shape == shape && out.points->size() == cloud.size()) return out;
  out = {};
  for (const auto& p : cloud) {
    out.points->emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()));
    const Eigen::Vector3f n = Eigen::Vector3d(p.x(), 0.0, p.z() - 1000.0).normalized().cast<float>();
    out.normals->emplace_back(n.x(), n.y(), n.z());
  }
  of = cloud.data();
  of_shape = shape;
  return out;
}

template <class Model>
Answer optimised(Model& model, Shape shape, Eigen::VectorXf start, bool has_outliers) {
  pcl::Indices inliers;
  if (has_outliers) {
    pcl::RandomSampleConsensus<pcl::PointXYZ> ransac(model, 3.0 * kNoise_mm);
    ransac.computeModel();
    ransac.getInliers(inliers);
    ransac.getModelCoefficients(start);
  } else {
    inliers = *model->getIndices();
  }
  Eigen::VectorXf best;
  model->optimizeModelCoefficients(inliers, start, best);
  const Eigen::VectorXd b = best.cast<double>();
  if (shape == Shape::plane) return {-b[3] * b.head<3>(), b.head<3>(), 0};
  if (shape == Shape::sphere) return {b.head<3>(), {}, b[3]};
  return {b.head<3>(), b.segment<3>(3).normalized(), b[6]};
}

Answer by_pcl(Shape shape, const Cloud& cloud, const Answer& s, bool has_outliers) {
  const PclCloud& pcl = as_pcl(shape, cloud);
  Eigen::VectorXf start;
  if (shape == Shape::plane) {
    start = Eigen::Vector4d(s.direction.x(), s.direction.y(), s.direction.z(), -s.direction.dot(s.place)).cast<float>();
    pcl::SampleConsensusModelPlane<pcl::PointXYZ>::Ptr model(
        new pcl::SampleConsensusModelPlane<pcl::PointXYZ>(pcl.points));
    return optimised(model, shape, start, has_outliers);
  }
  if (shape == Shape::sphere) {
    start = Eigen::Vector4d(s.place.x(), s.place.y(), s.place.z(), s.radius).cast<float>();
    pcl::SampleConsensusModelSphere<pcl::PointXYZ>::Ptr model(
        new pcl::SampleConsensusModelSphere<pcl::PointXYZ>(pcl.points));
    return optimised(model, shape, start, has_outliers);
  }
  start.resize(7);
  start << s.place.cast<float>(), s.direction.cast<float>(), static_cast<float>(s.radius);
  using Model = pcl::SampleConsensusModelCylinder<pcl::PointXYZ, pcl::Normal>;
  Model::Ptr model(new Model(pcl.points));
  model->setInputNormals(pcl.normals);
  return optimised(model, shape, start, has_outliers);
}
#endif

/// The python that has scipy, or empty.
const std::string& python() {
  static const std::string found = [] {
    for (const char* name : {"python3", "/usr/bin/python3"}) {
      if (std::system(fmt::format("{} -c 'import scipy.optimize' >/dev/null 2>&1", name).c_str()) == 0)
        return std::string(name);
    }
    return std::string();
  }();
  return found;
}

/// scipy.optimize.least_squares with arrays and an analytic Jacobian, in a process of its own that takes the time itself.
Answer by_scipy(Shape shape, const Cloud& cloud, const Answer& s, bool has_outliers, double* ms) {
  const auto file = std::filesystem::temp_directory_path() / fmt::format("fringecal_bench_{}.bin", getpid());
  {
    std::ofstream out(file, std::ios::binary);
    out.write(reinterpret_cast<const char*>(cloud.data()),
              static_cast<std::streamsize>(cloud.size() * sizeof(cloud[0])));
  }
  const std::string command = fmt::format(
      "OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 {} {}/tests/bench/scipy_peer.py {} {} {} {} {} {} {} {} {} {}",
      python(), FRINGECAL_SOURCE_DIR, name_of(shape), file.string(), has_outliers ? 1 : 0, s.place.x(), s.place.y(),
      s.place.z(), s.direction.x(), s.direction.y(), s.direction.z(), s.radius);
  std::string text;
  if (FILE* pipe = popen(command.c_str(), "r")) {
    char line[1024];
    while (std::fgets(line, sizeof line, pipe)) text += line;
    pclose(pipe);
  }
  std::filesystem::remove(file);
  std::istringstream in(text);
  Answer a;
  in >> *ms >> a.place.x() >> a.place.y() >> a.place.z() >> a.direction.x() >> a.direction.y() >> a.direction.z() >>
      a.radius;
  return a;
}

}  // namespace

Cloud points_of(Shape shape, std::size_t n) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> part(-1.0, 1.0);
  std::normal_distribution<double> noise(0.0, kNoise_mm);
  Cloud out;
  out.reserve(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double a = part(random), b = part(random), d = noise(random);
    if (shape == Shape::plane) {
      out.emplace_back(200 * a, 150 * b, 1000 + d);
    } else if (shape == Shape::sphere) {
      out.push_back(Eigen::Vector3d(10, 20, 1000) + (25 + d) * Eigen::Vector3d(a, b, 1.0).normalized());
    } else {
      out.emplace_back((60 + d) * std::sin(a), 100 * b, 1000 + (60 + d) * std::cos(a));
    }
  }
  return out;
}

Answer disturbed(Shape shape) {
  if (shape == Shape::plane) return {{0, 0, 1001}, Eigen::Vector3d(0.01, 0, 1).normalized(), 0};
  if (shape == Shape::sphere) return {{10.25, 19.75, 1000.25}, {}, 25.25};
  return {{0.6, 0, 1000.6}, Eigen::Vector3d(0.01, 1, 0.01).normalized(), 60.6};
}

std::vector<Peer> peers(Shape shape, bool has_outliers) {
  static double scipy_ms = 0;
  const bool scipy = !python().empty();
  std::vector<Peer> out;
  if (shape == Shape::plane && !has_outliers) out.push_back({"CGAL linear_least_squares_fitting_3", plane_by_cgal});
  if (shape != Shape::plane) {
    out.push_back({has_outliers ? "Ceres, one residual a point, Cauchy" : "Ceres, one residual a point",
                   [=](const Cloud& c, const Answer& s) { return by_ceres(shape, c, s, has_outliers); }});
  }
#ifdef FRINGECAL_HAVE_PCL
  out.push_back({has_outliers ? "PCL RANSAC + optimise" : "PCL optimise",
                 [=](const Cloud& c, const Answer& s) { return by_pcl(shape, c, s, has_outliers); }});
#endif
  if (scipy && shape != Shape::plane) {
    out.push_back({has_outliers ? "scipy least_squares, Cauchy" : "scipy least_squares",
                   [=](const Cloud& c, const Answer& s) { return by_scipy(shape, c, s, has_outliers, &scipy_ms); },
                   &scipy_ms});
  }
  return out;
}

std::string peers_left_out() {
  std::string out;
#ifndef FRINGECAL_HAVE_PCL
  out += "  PCL is not installed (libpcl-dev): left out\n";
#endif
  if (python().empty()) out += "  scipy is not installed (python3-scipy): left out\n";
  return out;
}

}  // namespace fringecal::bench
