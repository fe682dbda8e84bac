#include "fitting/kernels.h"

#include "core/parallel.h"

#include <algorithm>
#include <cstring>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "fitting/kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace fringecal::fitting {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
constexpr std::size_t kLanes = 8;  // running sums; the vectors of every target divide them
using D = hn::CappedTag<double, kLanes>;
using V = hn::Vec<D>;

constexpr int rows_of(KernelKind kind) {
  switch (kind) {
    case KernelKind::moments:
    case KernelKind::moments_mm:
      return 0;
    case KernelKind::plane:
      return 3;
    case KernelKind::sphere:
    case KernelKind::sphere_centre:
      return 4;
    case KernelKind::cylinder:
    case KernelKind::cylinder_axis:
      return 5;
  }
  return 0;
}
constexpr bool is_about_centre(KernelKind kind) {
  return kind == KernelKind::sphere_centre || kind == KernelKind::cylinder_axis;
}
constexpr bool is_moments(KernelKind kind) { return rows_of(kind) == 0; }
constexpr int sums_of(KernelKind kind) {
  const int of_rows = rows_of(kind) * (rows_of(kind) + 3) / 2 + 1;
  return is_moments(kind) ? 9 : kind == KernelKind::cylinder_axis ? of_rows + 1 : of_rows;
}

/// A task's constants in vectors.
struct Frame {
  V ox, oy, oz, unit, ax, ay, az, e[9], k, radius, out_unit;
};

HWY_INLINE Frame frame_of(const KernelTask& t) {
  const D d;
  Frame f;
  f.ox = hn::Set(d, t.origin_mm.x());
  f.oy = hn::Set(d, t.origin_mm.y());
  f.oz = hn::Set(d, t.origin_mm.z());
  f.unit = hn::Set(d, t.inverse_scale);
  f.ax = hn::Set(d, t.anchor.x());
  f.ay = hn::Set(d, t.anchor.y());
  f.az = hn::Set(d, t.anchor.z());
  for (int i = 0; i < 9; ++i) f.e[i] = hn::Set(d, t.axes.data()[i]);
  f.k = hn::Set(d, t.k);
  f.radius = hn::Set(d, t.radius_mm);
  f.out_unit = hn::Set(d, t.distance_unit);
  return f;
}

/// surface.h, eq. 1 and its derivative by k; one division for both quotients.
struct Curved {
  V d, inverse_D, dd_dk;
};
HWY_INLINE Curved curved(V A, V q, V k) {
  const D t;
  const V one = hn::Set(t, 1.0);
  const V root = hn::Sqrt(hn::Max(hn::Zero(t), hn::Add(one, hn::Mul(k, A))));
  const V divisor = hn::Max(root, hn::Set(t, 1e-150));
  const V sum = hn::Add(one, divisor);
  const V both = hn::Div(one, hn::Mul(divisor, sum));
  Curved c;
  c.inverse_D = hn::Mul(both, sum);
  const V inverse_sum = hn::Mul(both, divisor);
  c.d = hn::Mul(A, inverse_sum);
  const V half = hn::Mul(hn::Set(t, 0.5), hn::Mul(hn::Mul(inverse_sum, inverse_sum), c.inverse_D));
  c.dd_dk = hn::Sub(hn::Mul(q, inverse_sum), hn::Mul(hn::Mul(A, hn::Add(A, hn::Mul(k, q))), half));
  return c;
}

/// The row J and the distance of surface.h, in the order of its parameters.
template <KernelKind kKind>
HWY_INLINE V linearize(const Frame& f, V x, V y, V z, V* HWY_RESTRICT row) {
  const D t;
  if constexpr (kKind == KernelKind::plane) {
    row[0] = hn::Set(t, -1.0);
    row[1] = x;
    row[2] = y;
    return z;
  } else if constexpr (is_about_centre(kKind)) {  // eq. 4
    constexpr bool kSphere = kKind == KernelKind::sphere_centre;
    V q = hn::Add(hn::Mul(x, x), hn::Mul(y, y));
    if constexpr (kSphere) q = hn::Add(q, hn::Mul(z, z));
    const V size = hn::Sqrt(q);
    const V inverse = hn::Div(hn::Set(t, 1.0), hn::Max(size, hn::Set(t, 1e-150)));
    row[0] = hn::Mul(x, inverse);
    row[1] = hn::Mul(y, inverse);
    row[2] = kSphere ? hn::Mul(z, inverse) : hn::Mul(z, row[0]);
    if constexpr (!kSphere) row[3] = hn::Mul(z, row[1]);
    row[rows_of(kKind) - 1] = hn::Set(t, 1.0);
    return hn::Sub(size, f.radius);
  } else if constexpr (kKind == KernelKind::sphere) {
    const V q = hn::Add(hn::Add(hn::Mul(x, x), hn::Mul(y, y)), hn::Mul(z, z));
    const Curved c = curved(hn::Sub(hn::Mul(f.k, q), hn::Add(z, z)), q, f.k);
    row[0] = hn::Mul(hn::Sub(hn::Set(t, 1.0), hn::Mul(f.k, z)), c.inverse_D);
    row[1] = hn::Neg(hn::Mul(x, c.inverse_D));
    row[2] = hn::Neg(hn::Mul(y, c.inverse_D));
    row[3] = c.dd_dk;
    return c.d;
  } else {
    const V q = hn::Add(hn::Mul(x, x), hn::Mul(y, y));
    const Curved c = curved(hn::Sub(hn::Mul(f.k, q), hn::Add(x, x)), q, f.k);
    const V side = hn::Neg(hn::Mul(y, c.inverse_D));
    row[0] = hn::Mul(hn::Sub(hn::Set(t, 1.0), hn::Mul(f.k, x)), c.inverse_D);
    row[1] = side;
    row[2] = hn::Mul(row[0], z);
    row[3] = hn::Mul(hn::Mul(f.k, z), side);
    row[4] = c.dd_dk;
    return c.d;
  }
}

/// Everything of one vector of points. w: null for weight one.
template <KernelKind kKind, bool kWeighted, bool kMatrix>
HWY_INLINE V add(const Frame& f, const double* HWY_RESTRICT p, V w, V* HWY_RESTRICT sums, V* largest, V* smallest) {
  const D t;
  V px, py, pz;
  hn::LoadInterleaved3(t, p, px, py, pz);
  V x, y, z;
  V tx = hn::Sub(px, f.ox), ty = hn::Sub(py, f.oy), tz = hn::Sub(pz, f.oz);  // eq. 1
  if constexpr (!is_about_centre(kKind) && kKind != KernelKind::moments_mm) {
    tx = hn::Mul(tx, f.unit);
    ty = hn::Mul(ty, f.unit);
    tz = hn::Mul(tz, f.unit);
  }
  if constexpr (kKind != KernelKind::moments_mm) {
    tx = hn::Sub(tx, f.ax);
    ty = hn::Sub(ty, f.ay);
    tz = hn::Sub(tz, f.az);
  }
  if constexpr (kKind == KernelKind::sphere_centre || kKind == KernelKind::moments_mm) {
    x = tx;
    y = ty;
    z = tz;
  } else {
    x = hn::Add(hn::Add(hn::Mul(f.e[0], tx), hn::Mul(f.e[1], ty)), hn::Mul(f.e[2], tz));
    y = hn::Add(hn::Add(hn::Mul(f.e[3], tx), hn::Mul(f.e[4], ty)), hn::Mul(f.e[5], tz));
    z = hn::Add(hn::Add(hn::Mul(f.e[6], tx), hn::Mul(f.e[7], ty)), hn::Mul(f.e[8], tz));
  }
  const auto weighted = [&](V v) { return kWeighted ? hn::Mul(w, v) : v; };
  const auto extend = [&](V out) {
    V high = out, low = out;
    if constexpr (kWeighted) {
      const auto counts = hn::Gt(w, hn::Zero(t));
      high = hn::IfThenElse(counts, out, *largest);
      low = hn::IfThenElse(counts, out, *smallest);
    }
    *largest = hn::Max(*largest, high);
    if constexpr (!is_moments(kKind)) *smallest = hn::Min(*smallest, low);
  };
  if constexpr (is_moments(kKind)) {
    const V wx = weighted(x), wy = weighted(y), wz = weighted(z);
    sums[0] = hn::Add(sums[0], wx);
    sums[1] = hn::Add(sums[1], wy);
    sums[2] = hn::Add(sums[2], wz);
    sums[3] = hn::Add(sums[3], hn::Mul(wx, x));
    sums[4] = hn::Add(sums[4], hn::Mul(wx, y));
    sums[5] = hn::Add(sums[5], hn::Mul(wx, z));
    sums[6] = hn::Add(sums[6], hn::Mul(wy, y));
    sums[7] = hn::Add(sums[7], hn::Mul(wy, z));
    sums[8] = hn::Add(sums[8], hn::Mul(wz, z));
    const V size = hn::Max(hn::Abs(x), hn::Max(hn::Abs(y), hn::Abs(z)));
    extend(size);
    return size;
  } else {
    constexpr int kRows = rows_of(kKind);
    V row[kRows];
    const V d = linearize<kKind>(f, x, y, z, row);
    int s = 0;
    V* to_d = sums + kRows * (kRows + 1) / 2;
#pragma GCC unroll 5
    for (int c = 0; c < kRows; ++c) {  // eq. 2; unrolled, or the sums live in memory
      const V wc = weighted(row[c]);
#pragma GCC unroll 5
      for (int r = c; kMatrix && r < kRows; ++r, ++s) sums[s] = hn::Add(sums[s], hn::Mul(wc, row[r]));
      to_d[c] = hn::Add(to_d[c], hn::Mul(wc, d));
    }
    to_d[kRows] = hn::Add(to_d[kRows], hn::Mul(weighted(d), d));
    if constexpr (kKind == KernelKind::cylinder_axis) to_d[kRows + 1] = hn::Add(to_d[kRows + 1], weighted(z));
    const V out = is_about_centre(kKind) ? d : hn::Mul(d, f.out_unit);
    extend(out);
    return out;
  }
}

/// The weights of the points first .. first + lanes - 1.
HWY_INLINE V weights_at(const PointWeights& weights, std::size_t first) {
  const D t;
  V w = weights.weights ? hn::LoadU(t, weights.weights + first) : hn::Set(t, 1.0);
  if (weights.used) {
    std::uint8_t bits[8] = {static_cast<std::uint8_t>(weights.used[first / 8] >> (first % 8))};
    w = hn::IfThenElseZero(hn::LoadMaskBits(t, bits), w);
  }
  return w;
}

/// The points first .. first + count - 1, count a multiple of kLanes.
template <KernelKind kKind, bool kWeighted, bool kMatrix>
void add_block(const KernelTask& task, const Frame& f, std::size_t first, std::size_t count, KernelSums& total) {
  constexpr int kSums = sums_of(kKind);
  const D t;
  const std::size_t width = hn::Lanes(t);
  HWY_ALIGN double lanes[KernelSums::kMost][kLanes];
  HWY_ALIGN double high[kLanes], low[kLanes];
  for (std::size_t part = 0; part < kLanes; part += width) {
    V sums[kSums];
#pragma GCC unroll 22
    for (int s = 0; s < kSums; ++s) sums[s] = hn::Zero(t);
    V largest = hn::Set(t, -1e300), smallest = hn::Set(t, 1e300), w = hn::Set(t, 1.0);
    for (std::size_t i = first + part; i < first + count; i += kLanes) {
      if constexpr (kWeighted) w = weights_at(task.weights, i);
      const V out = add<kKind, kWeighted, kMatrix>(f, task.points_mm[i].data(), w, sums, &largest, &smallest);
      if (!is_moments(kKind) && task.distances) hn::StoreU(out, t, task.distances + i);
    }
#pragma GCC unroll 22
    for (int s = 0; s < kSums; ++s) hn::Store(sums[s], t, lanes[s] + part);
    hn::Store(largest, t, high + part);
    hn::Store(smallest, t, low + part);
  }
  for (int s = 0; s < kSums; ++s) {
    const double* l = lanes[s];
    total.sums[s] += ((l[0] + l[1]) + (l[2] + l[3])) + ((l[4] + l[5]) + (l[6] + l[7]));
  }
  for (std::size_t i = 0; i < kLanes; ++i) {
    total.largest = std::max(total.largest, high[i]);
    total.smallest = std::min(total.smallest, low[i]);
  }
}

template <KernelKind kKind, bool kMatrix>
void add_range_of(const KernelTask& task, std::size_t first, std::size_t count, KernelSums& total) {
  constexpr std::size_t kBlock = 1024;
  const Frame f = frame_of(task);
  const bool weighted = task.weights.used || task.weights.weights;
  const std::size_t whole = count / kLanes * kLanes;
  for (std::size_t at = 0; at < whole; at += kBlock) {
    const std::size_t n = std::min(task.of_each_block, whole - at);
    if (weighted) {
      add_block<kKind, true, kMatrix>(task, f, first + at, n, total);
    } else {
      add_block<kKind, false, kMatrix>(task, f, first + at, n, total);
    }
  }
  if (whole == count || task.of_each_block < kBlock) return;
  // The last few points, filled up with copies of the last one that do not count.
  Eigen::Vector3d padded[kLanes];
  double weights[kLanes] = {}, distances[kLanes];
  for (std::size_t i = 0; i < kLanes; ++i) {
    const std::size_t from = first + std::min(whole + i, count - 1);
    padded[i] = task.points_mm[from];
    if (whole + i >= count) continue;
    weights[i] = task.weights.weights ? task.weights.weights[from] : 1.0;
    if (task.weights.used && !(task.weights.used[from / 8] >> (from % 8) & 1)) weights[i] = 0.0;
  }
  KernelTask last = task;
  last.points_mm = padded;
  last.weights = {nullptr, weights};
  last.distances = task.distances ? distances : nullptr;
  add_block<kKind, true, kMatrix>(last, f, 0, kLanes, total);
  if (!is_moments(kKind) && task.distances) std::copy_n(distances, count - whole, task.distances + first + whole);
}

template <KernelKind kKind>
void add_range_with(const KernelTask& task, std::size_t first, std::size_t count, KernelSums& total) {
  if (task.wanted == KernelSumsWanted::all) return add_range_of<kKind, true>(task, first, count, total);
  add_range_of<kKind, false>(task, first, count, total);
}

void add_range(const KernelTask& task, std::size_t first, std::size_t count, KernelSums& total) {
  switch (task.kind) {
    case KernelKind::moments:
      return add_range_of<KernelKind::moments, true>(task, first, count, total);
    case KernelKind::moments_mm:
      return add_range_of<KernelKind::moments_mm, true>(task, first, count, total);
    case KernelKind::plane:
      return add_range_with<KernelKind::plane>(task, first, count, total);
    case KernelKind::sphere:
      return add_range_of<KernelKind::sphere, true>(task, first, count, total);
    case KernelKind::cylinder:
      return add_range_of<KernelKind::cylinder, true>(task, first, count, total);
    case KernelKind::sphere_centre:
      return add_range_with<KernelKind::sphere_centre>(task, first, count, total);
    case KernelKind::cylinder_axis:
      return add_range_with<KernelKind::cylinder_axis>(task, first, count, total);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace fringecal::fitting
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fringecal::fitting {

HWY_EXPORT(add_range);

KernelSums run_kernel(const KernelTask& task) {
  constexpr std::size_t kChunk = 16384;     // a multiple of the block; the unit of work of a thread
  constexpr std::size_t kWorthThreads = 4;  // chunks: below, starting a thread costs more than it gains
  const std::size_t n = task.points_mm.size(), chunks = (n + kChunk - 1) / kChunk;
  const auto run = [](const KernelTask& t, std::size_t first, std::size_t count, KernelSums& sums) {
    HWY_DYNAMIC_DISPATCH(add_range)(t, first, count, sums);
  };
  if (chunks <= 1) {
    KernelSums total;
    if (n > 0) run(task, 0, n, total);
    return total;
  }
  std::vector<KernelSums> parts(chunks);
  const auto work = [&](int c) {
    const std::size_t first = static_cast<std::size_t>(c) * kChunk;
    run(task, first, std::min(kChunk, n - first), parts[static_cast<std::size_t>(c)]);
  };
  if (chunks < kWorthThreads) {
    for (std::size_t c = 0; c < chunks; ++c) work(static_cast<int>(c));
  } else {
    // Each thread in a stretch of its own: neighbours would wait for each other where fresh memory is first written.
    const auto threads = static_cast<std::size_t>(thread_count()), stretch = (chunks + threads - 1) / threads;
    parallel_for(static_cast<int>(threads * stretch), [&](int i) {
      const auto task_of = static_cast<std::size_t>(i);
      const std::size_t c = task_of % threads * stretch + task_of / threads;
      if (c < chunks) work(static_cast<int>(c));
    });
  }
  KernelSums total;
  for (const KernelSums& part : parts) {
    for (int s = 0; s < KernelSums::kMost; ++s) total.sums[s] += part.sums[s];
    total.largest = std::max(total.largest, part.largest);
    total.smallest = std::min(total.smallest, part.smallest);
  }
  return total;
}

}  // namespace fringecal::fitting
#endif
