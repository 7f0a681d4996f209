#include "toolkit/spline_sdf/spline.h"

#include <cstddef>
#include <cstdint>

#include "toolkit/core/simd.h"

namespace palpate::spline_sdf {
namespace {

using Weights = std::array<Float4, 4>;

/// Offset of a row to the next node along x.
constexpr int kRowStep = kBrickNodes * kBrickNodes;

int first_node(const BrickPosition& at) noexcept {
  return (at.cell[0] * kBrickNodes + at.cell[1]) * kBrickNodes + at.cell[2];
}

// Inlined into both forms, to be compiled for each.
#define PALPATE_BOTH [[gnu::always_inline]] inline

/// The four weights and derivative weights along each axis; lanes 0 to 2 of weight k are x, y and z.
struct SplineWeights {
  Weights value, first, second;
};
PALPATE_BOTH Float4 place_lanes(const BrickPosition& at) noexcept {
  return Float4{at.t[0], at.t[1], at.t[2], 0.0f};
}
PALPATE_BOTH Weights value_weights(Float4 t) noexcept {
  const Float4 s = 1.0f - t;
  constexpr float kSixth = 1.0f / 6.0f, kTwoThirds = 2.0f / 3.0f;
  return {s * s * s * kSixth, kTwoThirds - t * t * (1.0f - 0.5f * t), kTwoThirds - s * s * (1.0f - 0.5f * s),
          t * t * t * kSixth};
}
PALPATE_BOTH SplineWeights all_weights(Float4 t) noexcept {
  const Float4 s = 1.0f - t;
  return {value_weights(t),
          {-0.5f * s * s, t * (1.5f * t - 2.0f), s * (2.0f - 1.5f * s), 0.5f * t * t},
          {s, 3.0f * t - 2.0f, 1.0f - 3.0f * t, t}};
}

/// Broadcasts lane kAxis (0 to 2) to four lanes.
template <int kAxis>
PALPATE_BOTH Float4 spread(Float4 a) noexcept {
  return __builtin_shufflevector(a, a, kAxis, kAxis, kAxis, kAxis);
}
/// The weights along z, in order.
PALPATE_BOTH Float4 along_z(const Weights& of) noexcept {
  return __builtin_shufflevector(__builtin_shufflevector(of[0], of[1], 2, 6, 2, 6),
                                 __builtin_shufflevector(of[2], of[3], 2, 6, 2, 6), 0, 1, 4, 5);
}
PALPATE_BOTH float sum_of(Float4 a) noexcept {
  return (a[0] + a[2]) + (a[1] + a[3]);
}
/// sum_of() each of four.
PALPATE_BOTH Float4 sums_of(Float4 a, Float4 b, Float4 c, Float4 d) noexcept {
  const Float4 ab = __builtin_shufflevector(a, b, 0, 4, 1, 5) + __builtin_shufflevector(a, b, 2, 6, 3, 7);
  const Float4 cd = __builtin_shufflevector(c, d, 0, 4, 1, 5) + __builtin_shufflevector(c, d, 2, 6, 3, 7);
  return __builtin_shufflevector(ab, cd, 0, 1, 4, 5) + __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
}

/// Per node along z: sums over x and y of values and of derivatives along x and y.
struct Columns {
  Float4 f, fx, fy, fxx, fyy, fxy;
};
PALPATE_BOTH Jet jet_of(const Columns& c, const SplineWeights& w) noexcept {
  const Float4 z = along_z(w.value), dz = along_z(w.first), ddz = along_z(w.second);
  const Float4 low = kDistanceUnit * sums_of(c.f * z, c.fx * z, c.fy * z, c.f * dz);
  const Float4 high = kDistanceUnit * sums_of(c.fxx * z, c.fyy * z, c.f * ddz, c.fxy * z);
  Jet jet;
  jet.value = low[0];
  jet.gradient = Eigen::Vector3f(low[1], low[2], low[3]);
  jet.second = {high[0],
                high[1],
                high[2],
                high[3],
                kDistanceUnit * sum_of(c.fx * dz),
                kDistanceUnit * sum_of(c.fy * dz)};
  return jet;
}

/// Four coefficients as floats. Each is duplicated into one integer and the lower copy shifted out, because
/// compilers split a conversion of four shorts.
Float4 row_at(const Brick& brick, int at) noexcept {
  Int16x8 raw{};
  __builtin_memcpy(&raw, &brick.distance[static_cast<std::size_t>(at)], 4 * sizeof(std::int16_t));
  const Int16x8 twice = __builtin_shufflevector(raw, raw, 0, 0, 1, 1, 2, 2, 3, 3);
  Int32x4 wide;
  __builtin_memcpy(&wide, &twice, sizeof wide);
  return __builtin_convertvector(wide >> 16, Float4);
}

/// The rows of the four nodes along x.
Weights rows_on(const Brick& brick, int at) noexcept {
  return {row_at(brick, at), row_at(brick, at + kRowStep), row_at(brick, at + 2 * kRowStep),
          row_at(brick, at + 3 * kRowStep)};
}
/// Their sum by the weights along x.
Float4 blended(const Weights& w, const Weights& row) noexcept {
  return (w[0] * row[0] + w[1] * row[1]) + (w[2] * row[2] + w[3] * row[3]);
}

#if defined(__x86_64__)

/// The rows at a node and its neighbour along y.
PALPATE_AVX2 inline Float8 rows_at(const Brick& brick, int at) noexcept {
  const std::int16_t* const from = &brick.distance[static_cast<std::size_t>(at)];
  std::array<std::int64_t, 2> both;
  __builtin_memcpy(&both[0], from, sizeof both[0]);
  __builtin_memcpy(&both[1], from + kBrickNodes, sizeof both[1]);
  Int16x8 raw;
  __builtin_memcpy(&raw, both.data(), sizeof raw);
  return __builtin_convertvector(__builtin_convertvector(raw, Int32x8), Float8);
}
PALPATE_AVX2 inline std::array<Float8, 4> wide_rows_on(const Brick& brick, int at) noexcept {
  return {rows_at(brick, at), rows_at(brick, at + kRowStep), rows_at(brick, at + 2 * kRowStep),
          rows_at(brick, at + 3 * kRowStep)};
}
PALPATE_AVX2 inline Float8 twice(Float4 a) noexcept {
  return __builtin_shufflevector(a, a, 0, 0, 0, 0, 0, 0, 0, 0);
}
PALPATE_AVX2 inline Float8 blended(const std::array<Float8, 4>& w,
                                   const std::array<Float8, 4>& row) noexcept {
  return (w[0] * row[0] + w[1] * row[1]) + (w[2] * row[2] + w[3] * row[3]);
}
/// The weights along y of a row and its neighbour.
PALPATE_AVX2 inline Float8 beside(Float4 a, Float4 b) noexcept {
  return __builtin_shufflevector(a, b, 1, 1, 1, 1, 5, 5, 5, 5);
}
PALPATE_AVX2 inline Float4 both_of(Float8 a) noexcept {
  return __builtin_shufflevector(a, a, 0, 1, 2, 3) + __builtin_shufflevector(a, a, 4, 5, 6, 7);
}

PALPATE_AVX2 Jet wide_spline_jet(const Brick& brick, const BrickPosition& at) noexcept {
  const SplineWeights w = all_weights(place_lanes(at));
  const int base = first_node(at);
  std::array<Float8, 4> x, dx, ddx;
#pragma GCC unroll 4
  for (std::size_t i = 0; i < 4; ++i) {
    x[i] = twice(w.value[i]);
    dx[i] = twice(w.first[i]);
    ddx[i] = twice(w.second[i]);
  }
  std::array<Float8, 6> sum{};
#pragma GCC unroll 2
  for (std::size_t j = 0; j < 4; j += 2) {
    const int here = base + static_cast<int>(j) * kBrickNodes;
    const std::array<Float8, 4> row = wide_rows_on(brick, here);
    const Float8 a = blended(x, row), ax = blended(dx, row), axx = blended(ddx, row);
    const Float8 y = beside(w.value[j], w.value[j + 1]), dy = beside(w.first[j], w.first[j + 1]);
    sum[0] += y * a;
    sum[1] += y * ax;
    sum[2] += dy * a;
    sum[3] += y * axx;
    sum[4] += beside(w.second[j], w.second[j + 1]) * a;
    sum[5] += dy * ax;
  }
  return jet_of(
      {both_of(sum[0]), both_of(sum[1]), both_of(sum[2]), both_of(sum[3]), both_of(sum[4]), both_of(sum[5])},
      w);
}

PALPATE_AVX2 float wide_spline_value(const Brick& brick, const BrickPosition& at) noexcept {
  const Weights w = value_weights(place_lanes(at));
  const int base = first_node(at);
  const std::array<Float8, 4> x{twice(w[0]), twice(w[1]), twice(w[2]), twice(w[3])};
  Float8 sum{};
#pragma GCC unroll 2
  for (std::size_t j = 0; j < 4; j += 2) {
    const int here = base + static_cast<int>(j) * kBrickNodes;
    const std::array<Float8, 4> row = wide_rows_on(brick, here);
    sum += beside(w[j], w[j + 1]) * blended(x, row);
  }
  return kDistanceUnit * sum_of(both_of(sum) * along_z(w));
}

const bool kWide = has_avx2();

#endif

}  // namespace

// Summed in the order of the eight-lane form: even rows, odd rows, then both.
Jet narrow_spline_jet(const Brick& brick, const BrickPosition& at) noexcept {
  const SplineWeights w = all_weights(place_lanes(at));
  const int base = first_node(at);
  Weights x, dx, ddx;
  for (std::size_t i = 0; i < 4; ++i) {
    x[i] = spread<0>(w.value[i]);
    dx[i] = spread<0>(w.first[i]);
    ddx[i] = spread<0>(w.second[i]);
  }
  std::array<Columns, 2> sum{};
#pragma GCC unroll 4
  for (std::size_t j = 0; j < 4; ++j) {
    const int here = base + static_cast<int>(j) * kBrickNodes;
    const Weights row = rows_on(brick, here);
    const Float4 a = blended(x, row), ax = blended(dx, row), axx = blended(ddx, row);
    const Float4 y = spread<1>(w.value[j]), dy = spread<1>(w.first[j]);
    Columns& c = sum[j % 2];
    c.f += y * a;
    c.fx += y * ax;
    c.fy += dy * a;
    c.fxx += y * axx;
    c.fyy += spread<1>(w.second[j]) * a;
    c.fxy += dy * ax;
  }
  const auto& [even, odd] = sum;
  return jet_of({even.f + odd.f, even.fx + odd.fx, even.fy + odd.fy, even.fxx + odd.fxx, even.fyy + odd.fyy,
                 even.fxy + odd.fxy},
                w);
}

float narrow_spline_value(const Brick& brick, const BrickPosition& at) noexcept {
  const Weights w = value_weights(place_lanes(at));
  const int base = first_node(at);
  const Weights x{spread<0>(w[0]), spread<0>(w[1]), spread<0>(w[2]), spread<0>(w[3])};
  std::array<Float4, 2> sum{};
#pragma GCC unroll 4
  for (std::size_t j = 0; j < 4; ++j) {
    const int here = base + static_cast<int>(j) * kBrickNodes;
    const Weights row = rows_on(brick, here);
    sum[j % 2] += spread<1>(w[j]) * blended(x, row);
  }
  return kDistanceUnit * sum_of((sum[0] + sum[1]) * along_z(w));
}

Jet spline_jet(const Brick& brick, const BrickPosition& at) noexcept {
#if defined(__x86_64__)
  if (kWide) return wide_spline_jet(brick, at);
#endif
  return narrow_spline_jet(brick, at);
}

float spline_value(const Brick& brick, const BrickPosition& at) noexcept {
#if defined(__x86_64__)
  if (kWide) return wide_spline_value(brick, at);
#endif
  return narrow_spline_value(brick, at);
}

}  // namespace palpate::spline_sdf
