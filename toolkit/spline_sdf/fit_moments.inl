// Included once per vector width by fit_moments.cpp, hence no include guard. PALPATE_SUMS: its namespace;
// PALPATE_TARGET: the functions' attribute. Without wide registers a vector of four becomes two of two;
// nothing is passed by value.
namespace PALPATE_SUMS {

using V = Double4;
using Counts = Int64x4;

// Macros, because functions would pass vectors by value.
#define PALPATE_LOAD(to, from) __builtin_memcpy(&(to), (from), sizeof(V))
#define PALPATE_STORE(to, value) __builtin_memcpy((to), &(value), sizeof(V))
#define PALPATE_SUM(of) (((of)[0] + (of)[2]) + ((of)[1] + (of)[3]))

PALPATE_TARGET void moments(const FitLanes& p, const FitFrame& f, const FitHeight& c, double per_scale,
                            FitMoments& out) {
  std::array<V, 15> m{};
  std::array<V, 6> r{};
  for (std::size_t i = 0; i < p.count; i += FitPoints::kSimdWidth) {
    V x, y, z, real;
    PALPATE_LOAD(x, p.x + i);
    PALPATE_LOAD(y, p.y + i);
    PALPATE_LOAD(z, p.z + i);
    PALPATE_LOAD(real, p.real + i);
    x -= f.shift[0];
    y -= f.shift[1];
    z -= f.shift[2];
    const V a = x * f.u[0] + y * f.u[1] + z * f.u[2], b = x * f.v[0] + y * f.v[1] + z * f.v[2];
    const V w = x * f.w[0] + y * f.w[1] + z * f.w[2];
    PALPATE_STORE(p.u + i, a);
    PALPATE_STORE(p.v + i, b);
    PALPATE_STORE(p.w + i, w);
    const V aa = a * a, ab = a * b, bb = b * b;
    const V left = 1.0 - aa - bb;
    V k = (left > 0.0 ? left : V{}) * real;
    if (per_scale != 0.0) {
      const V off = (w - (c[0] + a * (c[1] + c[3] * a + c[4] * b) + b * (c[2] + c[5] * b))) * per_scale;
      const V most = 1.0 + off * off;
      k /= most * most;
    }
    const V kaa = k * aa, kab = k * ab, kbb = k * bb, kw = k * w;
    m[0] += k;
    m[1] += k * a;
    m[2] += k * b;
    m[3] += kaa;
    m[4] += kab;
    m[5] += kbb;
    m[6] += kaa * a;
    m[7] += kaa * b;
    m[8] += kbb * a;
    m[9] += kbb * b;
    m[10] += kaa * aa;
    m[11] += kaa * ab;
    m[12] += kaa * bb;
    m[13] += kbb * ab;
    m[14] += kbb * bb;
    r[0] += kw;
    r[1] += kw * a;
    r[2] += kw * b;
    r[3] += kw * aa;
    r[4] += kw * ab;
    r[5] += kw * bb;
  }
  for (std::size_t i = 0; i < m.size(); ++i) out.m[i] = PALPATE_SUM(m[i]);
  for (std::size_t i = 0; i < r.size(); ++i) out.r[i] = PALPATE_SUM(r[i]);
}

/// Returns their sum.
PALPATE_TARGET double residuals(const FitLanes& p, const FitHeight& c) {
  V sum{};
  for (std::size_t i = 0; i < p.count; i += FitPoints::kSimdWidth) {
    V a, b, w, real;
    PALPATE_LOAD(a, p.u + i);
    PALPATE_LOAD(b, p.v + i);
    PALPATE_LOAD(w, p.w + i);
    PALPATE_LOAD(real, p.real + i);
    const V off = w - (c[0] + a * (c[1] + c[3] * a + c[4] * b) + b * (c[2] + c[5] * b));
    const V size = off < 0.0 ? -off : off;
    PALPATE_STORE(p.off + i, size);
    sum += size * real;
  }
  return PALPATE_SUM(sum);
}

/// Number of residuals below a value.
PALPATE_TARGET std::size_t below(const FitLanes& p, double value) {
  const V most = V{} + value;
  Counts less{};
  for (std::size_t i = 0; i < p.count; i += FitPoints::kSimdWidth) {
    V off;
    PALPATE_LOAD(off, p.off + i);
    less -= off < most;
  }
  return static_cast<std::size_t>(PALPATE_SUM(less));
}

/// Writes the residuals in [low, high) in order and returns their number.
PALPATE_TARGET std::size_t between(const FitLanes& p, double low, double high, double* out) {
  std::size_t few = 0;
  for (std::size_t i = 0; i < p.count; i += FitPoints::kSimdWidth) {
    V off;
    PALPATE_LOAD(off, p.off + i);
    const Counts inside = (off >= low) & (off < high);
    if ((inside[0] | inside[1] | inside[2] | inside[3]) == 0) continue;
    for (std::size_t k = 0; k < FitPoints::kSimdWidth; ++k) {
      out[few] = off[k];
      few -= static_cast<std::size_t>(inside[k]);
    }
  }
  return few;
}

/// The residual of a rank; equal ones are interchangeable.
PALPATE_TARGET double of_rank(const FitLanes& p, std::size_t points, std::size_t rank) {
  const auto asked = static_cast<std::int64_t>(rank);
  for (std::size_t i = 0; i < points; ++i) {
    const V one = V{} + p.off[i];
    Counts less{}, up_to{};
    for (std::size_t j = 0; j < p.count; j += FitPoints::kSimdWidth) {
      V other;
      PALPATE_LOAD(other, p.off + j);
      less -= other < one;
      up_to -= other <= one;
    }
    if (PALPATE_SUM(less) <= asked && asked < PALPATE_SUM(up_to)) return p.off[i];
  }
  return p.off[rank];  // some are NaN
}

PALPATE_TARGET double weights(const FitLanes& p, const FitFrame& f, const FitHeight& c, double per_scale) {
  V sum{};
  for (std::size_t i = 0; i < p.count; i += FitPoints::kSimdWidth) {
    V x, y, z, real;
    PALPATE_LOAD(x, p.x + i);
    PALPATE_LOAD(y, p.y + i);
    PALPATE_LOAD(z, p.z + i);
    PALPATE_LOAD(real, p.real + i);
    x -= f.shift[0];
    y -= f.shift[1];
    z -= f.shift[2];
    const V a = x * f.u[0] + y * f.u[1] + z * f.u[2], b = x * f.v[0] + y * f.v[1] + z * f.v[2];
    const V w = x * f.w[0] + y * f.w[1] + z * f.w[2];
    const V off = (w - (c[0] + a * (c[1] + c[3] * a + c[4] * b) + b * (c[2] + c[5] * b))) * per_scale;
    const V most = 1.0 + off * off;
    sum += real / (most * most);
  }
  return PALPATE_SUM(sum);
}

#undef PALPATE_LOAD
#undef PALPATE_STORE
#undef PALPATE_SUM

}  // namespace PALPATE_SUMS
