// No include guard: tile_nodes.cpp takes it once for each width. PALPATE_NODES: its namespace; PALPATE_LANES:
// nodes at once; PALPATE_TARGET: the attribute of its functions.
namespace PALPATE_NODES {

using V = float __attribute__((vector_size(PALPATE_LANES * sizeof(float))));
using Yes = std::int32_t __attribute__((vector_size(PALPATE_LANES * sizeof(float))));

PALPATE_TARGET inline V load(const float* from) {
  V v;
  __builtin_memcpy(&v, from, sizeof v);
  return v;
}
PALPATE_TARGET inline void add_at(float* to, V v) {
  v = load(to) + v;
  __builtin_memcpy(to, &v, sizeof v);
}
PALPATE_TARGET inline V at_least(V x, float low) {
  const V least = V{} + low;
  return x > least ? x : least;
}
PALPATE_TARGET inline V at_most(V x, float high) {
  const V most = V{} + high;
  return x < most ? x : most;
}
PALPATE_TARGET inline bool any(Yes yes) {
  std::array<std::uint64_t, PALPATE_LANES / 2> pairs;
  __builtin_memcpy(pairs.data(), &yes, sizeof pairs);
  std::uint64_t found = 0;
  for (const std::uint64_t pair : pairs) found |= pair;
  return found != 0;
}
/// 1 / sqrt(1 + x) for x from 0: Newton's steps, which need no root and are rounded alike everywhere. Right
/// to 1e-5 up to a slope of one and better below.
PALPATE_TARGET inline V inverse_length(V x) {
  V y = 1.0f / (1.0f + 0.5f * x);
  for (int i = 0; i < kLengthSteps; ++i) y = y * (1.5f - 0.5f * (1.0f + x) * y * y);
  return y;
}

/// The distance is that to the tangent plane at the foot, found by one step from the first guess.
PALPATE_TARGET inline void add_part(const TilePatch& p, std::size_t part, TileSums& sums) {
  const float dx = kPartX[part] - p.at[0], middle_y = kPartY[part] - p.at[1];
  for (std::size_t lane = 0; lane < kPartNodes; lane += PALPATE_LANES) {
    const V dy = load(&kNodeY[lane]) + middle_y, dz = load(&kNodeZ[lane]) - p.at[2];
    const V a = dz * p.u[2] + (dy * p.u[1] + dx * p.u[0]), b = dz * p.v[2] + (dy * p.v[1] + dx * p.v[0]);
    const V w = dz * p.n[2] + (dy * p.n[1] + dx * p.n[0]);
    // Slope of the height at (a, b), and the drop along the normal there: the foot is about their product
    // back.
    const V s0 = 2.0f * p.uu * a + p.uv * b, t0 = 2.0f * p.vv * b + p.uv * a;
    const V back = (w - 0.5f * (s0 * a + t0 * b)) / (1.0f + s0 * s0 + t0 * t0);
    const V a1 = a + s0 * back, b1 = b + t0 * back;
    const V rest = at_least(1.0f - (a1 * a1 + b1 * b1) * p.per_support_sq, 0.0f);
    if (!any(rest > 0.0f)) continue;
    const V s1 = 2.0f * p.uu * a1 + p.uv * b1, t1 = 2.0f * p.vv * b1 + p.uv * a1;
    const V inverse = inverse_length(s1 * s1 + t1 * t1);
    const V f = ((w - 0.5f * (s1 * a1 + t1 * b1)) - (a - a1) * s1 - (b - b1) * t1) * inverse;
    const V near = kNearSquare + f * f;
    const V left = at_most(at_least((1.0f - f * p.bend - kLeastBend) * kBendFade, 0.0f), 1.0f);
    const V weight = p.trust * left * rest * rest * rest / (near * near);
    const V per = weight * inverse;
    const std::size_t i = kPartNodes * part + lane;
    add_at(&sums.weight[i], weight);
    add_at(&sums.distance[i], weight * (f + p.sharpen));
    add_at(&sums.x[i], per * (p.n[0] - s1 * p.u[0] - t1 * p.v[0]));
    add_at(&sums.y[i], per * (p.n[1] - s1 * p.u[1] - t1 * p.v[1]));
    add_at(&sums.z[i], per * (p.n[2] - s1 * p.u[2] - t1 * p.v[2]));
  }
}

PALPATE_TARGET void add(const TilePatch& p, TileSums& sums) {
  // No node of a part farther off than that is above the patch, wherever curvature puts its foot.
  const float reach = p.support + p.foot_room + part_radius(p.n);
  std::array<std::int32_t, kTileParts> near;
  for (std::size_t part = 0; part < kTileParts; part += PALPATE_LANES) {
    const V dx = load(&kPartX[part]) - p.at[0], dy = load(&kPartY[part]) - p.at[1];
    const V along = dx * p.n[0] + dy * p.n[1] - p.at[2] * p.n[2];
    const auto reaches = dx * dx + dy * dy + p.at[2] * p.at[2] - along * along <= V{} + reach * reach;
    __builtin_memcpy(&near[part], &reaches, sizeof reaches);
  }
  for (std::size_t part = 0; part < kTileParts; ++part)
    if (near[part] != 0) add_part(p, part, sums);
}

}  // namespace PALPATE_NODES
