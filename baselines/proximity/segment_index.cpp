#include "baselines/proximity/segment_index.h"

#include <embree3/rtcore.h>
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include <palpate/result.h>
#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

/// Coordinates up to 2^22 quanta have differences up to 2^23, exact in a float's 24 bits.
constexpr int kGridBits = 22;
/// Half a quantum of snapping, an eighth of vertex rounding per axis (x sqrt 3) and some ulps along the
/// segment are below two; doubled for safety.
constexpr double kMarginQuanta = 4.0;
/// Growth of the box, in quanta, before segments are clipped to it: no facet lies at a clipped end.
constexpr double kClipQuanta = 64.0;

bool monitor(void* counter, ssize_t bytes, bool /*post*/) {
  static_cast<std::atomic<std::ptrdiff_t>*>(counter)->fetch_add(bytes, std::memory_order_relaxed);
  return true;
}

struct FilterContext {
  RTCIntersectContext context;  // must be first: Embree returns its address
  const SurfaceMesh* mesh;
  std::uint32_t around;
};

void skip_neighbours(const RTCFilterFunctionNArguments* args) {
  const auto* context = reinterpret_cast<const FilterContext*>(args->context);
  const auto* hit = reinterpret_cast<const RTCHit*>(args->hit);
  if (share_vertex(context->mesh->facet(hit->primID), context->mesh->facet(context->around)))
    args->valid[0] = 0;
}

RTCRayHit ray_between(const Vec3f& start, const Vec3f& direction, float end) noexcept {
  RTCRayHit ray;
  ray.ray.org_x = start.x();
  ray.ray.org_y = start.y();
  ray.ray.org_z = start.z();
  ray.ray.dir_x = direction.x();
  ray.ray.dir_y = direction.y();
  ray.ray.dir_z = direction.z();
  ray.ray.tnear = 0.0f;
  ray.ray.tfar = end;
  ray.ray.time = 0.0f;
  ray.ray.mask = 0xFFFFFFFFu;
  ray.ray.id = 0;
  ray.ray.flags = 0;
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  ray.hit.primID = RTC_INVALID_GEOMETRY_ID;
  ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return ray;
}

struct CollectContext {
  RTCIntersectContext context;  // as above
  const SurfaceMesh* mesh;
  std::uint32_t from_vertex, to_vertex;
  std::vector<std::uint32_t>* facets;
};

/// Notes the hit and lets the ray continue.
void collect(const RTCFilterFunctionNArguments* args) {
  const auto* context = reinterpret_cast<const CollectContext*>(args->context);
  const std::uint32_t facet = reinterpret_cast<const RTCHit*>(args->hit)->primID;
  args->valid[0] = 0;
  for (const std::uint32_t v : context->mesh->facet(facet).vertex)
    if (v == context->from_vertex || v == context->to_vertex) return;
  context->facets->push_back(facet);
}

}  // namespace

struct SegmentIndex::State {
  const SurfaceMesh* mesh = nullptr;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::atomic<std::ptrdiff_t> bytes{0};
  LargePageUninitializedVector<float> vertices;         ///< in Embree's form
  LargePageUninitializedVector<std::uint32_t> corners;  ///< of a fast tree; else they are read from the mesh
  double quantum_mm = 0.0;
  double to_grid = 0.0;
  geometry::Aabb clip_box;

  State() = default;
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }

  [[nodiscard]] Vec3f snapped(const Vec3& p) const noexcept {
    Vec3f result;
    for (int axis = 0; axis < 3; ++axis)
      result[axis] = static_cast<float>(std::nearbyint(p[axis] * to_grid) * quantum_mm);
    return result;
  }

  /// Copies only vertices (as floats, the last one readable with 16 bytes); the rest is shared with the mesh.
  /// For a fast tree also the corners: among the facets' 96 bytes they cost it half of its time.
  void share(RTCGeometry geometry, int threads, TreeQuality quality) {
    const std::size_t n = mesh->vertices().size();
    vertices.resize(3 * n + 1);
    vertices.back() = 0.0f;
    parallel_each(n, kPointsPerChunk, threads, [this](std::size_t v) {
      for (std::size_t axis = 0; axis < 3; ++axis)
        vertices[3 * v + axis] = static_cast<float>(mesh->vertices()[v][static_cast<Eigen::Index>(axis)]);
    });
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, vertices.data(), 0,
                               3 * sizeof(float), n);
    const std::size_t facets = mesh->facets().size();
    const bool copied = quality == TreeQuality::kFast;
    if (copied) {
      corners.resize(3 * facets);
      for (std::size_t f = 0; f < facets; ++f)
        std::copy_n(mesh->facets()[f].vertex.begin(), 3,
                    corners.begin() + static_cast<std::ptrdiff_t>(3 * f));
    }
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               copied ? corners.data() : mesh->facets().front().vertex.data(), 0,
                               copied ? 3 * sizeof(std::uint32_t) : sizeof(Facet), facets);
  }

  /// Clips a -> b to the box; false if it misses. Ends inside are unchanged.
  [[nodiscard]] bool clip(Vec3& a, Vec3& b, double& from, double& to) const noexcept {
    from = 0.0;
    to = 1.0;
    if (clip_box.contains(a) && clip_box.contains(b)) return true;
    const Vec3 d = b - a;
    if (!clip_to_box(clip_box, a, d, 0.0, from, to)) return false;
    const Vec3 start = a;
    if (from > 0.0) a = start + d * from;
    if (to < 1.0) b = start + d * to;
    return true;
  }
};

SegmentIndex::SegmentIndex(std::unique_ptr<State> state) noexcept : state_(std::move(state)) {}
SegmentIndex::SegmentIndex(SegmentIndex&&) noexcept = default;
SegmentIndex& SegmentIndex::operator=(SegmentIndex&&) noexcept = default;
SegmentIndex::~SegmentIndex() = default;

Result<SegmentIndex> SegmentIndex::build(const SurfaceMesh& mesh, int threads, TreeQuality quality) {
  auto state = std::make_unique<State>();
  state->mesh = &mesh;
  const std::string config = threads > 0 ? fmt::format("threads={}", threads) : std::string();
  state->device = rtcNewDevice(config.empty() ? nullptr : config.c_str());
  if (state->device == nullptr)
    return Error{fmt::format("Embree did not start (code {})", static_cast<int>(rtcGetDeviceError(nullptr))),
                 "check the installed Embree against this machine's processor"};
  rtcSetDeviceMemoryMonitorFunction(state->device, monitor, &state->bytes);

  const double half =
      mesh.local_box_mm().low_mm.cwiseAbs().cwiseMax(mesh.local_box_mm().high_mm.cwiseAbs()).maxCoeff();
  // The grown box must fit in 2^kGridBits quanta: one exponent higher if nearly full.
  const int exponent =
      static_cast<int>(std::ceil(std::log2(std::max(half, std::numeric_limits<double>::min()) *
                                           (1.0 + kClipQuanta * std::ldexp(2.0, -kGridBits)))));
  state->quantum_mm = std::ldexp(1.0, exponent - kGridBits);
  state->to_grid = std::ldexp(1.0, kGridBits - exponent);
  state->clip_box = mesh.local_box_mm().grown(kClipQuanta * state->quantum_mm);
  if (!(state->quantum_mm > static_cast<double>(std::numeric_limits<float>::min())))
    return Error{"the mesh is too small for single precision", "give its unit, or scale it up"};

  RTCGeometry geometry = rtcNewGeometry(state->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  state->share(geometry, threads, quality);
  const RTCBuildQuality embree_quality =
      quality == TreeQuality::kFast ? RTC_BUILD_QUALITY_LOW : RTC_BUILD_QUALITY_MEDIUM;
  rtcSetGeometryBuildQuality(geometry, embree_quality);
  rtcCommitGeometry(geometry);
  state->scene = rtcNewScene(state->device);
  rtcSetSceneBuildQuality(state->scene, embree_quality);
  rtcSetSceneFlags(state->scene, static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST |
                                                            RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION));
  rtcAttachGeometryByID(state->scene, geometry, 0);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(state->scene);
  if (const RTCError code = rtcGetDeviceError(state->device); code != RTC_ERROR_NONE)
    return Error{fmt::format("Embree could not build its tree (code {})", static_cast<int>(code)),
                 "use a smaller mesh"};
  return SegmentIndex(std::move(state));
}

std::optional<SegmentHit> SegmentIndex::first_hit(const Vec3& a, const Vec3& b,
                                                  std::uint32_t ignore_around) const noexcept {
  Vec3 from = a, to = b;
  double t_from = 0.0, t_to = 1.0;
  if (!state_->clip(from, to, t_from, t_to)) return std::nullopt;
  const Vec3f start = state_->snapped(from), end = state_->snapped(to);
  const Vec3f direction = end - start;  // exact: see point 2 of the header
  const double length = direction.cast<double>().norm();
  if (!(length > 0.0)) return std::nullopt;
  RTCRayHit ray = ray_between(start, direction, static_cast<float>(1.0 + margin_mm() / length));
  FilterContext context;
  rtcInitIntersectContext(&context.context);
  context.context.filter = ignore_around == kNoFacet ? nullptr : skip_neighbours;
  context.mesh = state_->mesh;
  context.around = ignore_around;
  rtcIntersect1(state_->scene, &context.context, &ray);
  if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  const double along = std::min(1.0, static_cast<double>(ray.ray.tfar));
  return SegmentHit{ray.hit.primID, t_from + (t_to - t_from) * along};
}

void SegmentIndex::all_hits(std::uint32_t from_vertex, std::uint32_t to_vertex,
                            std::vector<std::uint32_t>& facets) const {
  const Vec3 a = state_->mesh->vertices()[from_vertex], b = state_->mesh->vertices()[to_vertex];
  const double length = (b - a).norm();
  if (!(length > 0.0)) return;                           // too close for squaring
  const Vec3 beyond = (b - a) * (margin_mm() / length);  // includes what an end lies on
  const Vec3f start = (a - beyond).cast<float>(), end = (b + beyond).cast<float>();
  RTCRayHit ray = ray_between(start, end - start, 1.0f);
  CollectContext context;
  rtcInitIntersectContext(&context.context);
  context.context.filter = collect;
  context.mesh = state_->mesh;
  context.from_vertex = from_vertex;
  context.to_vertex = to_vertex;
  context.facets = &facets;
  rtcIntersect1(state_->scene, &context.context, &ray);
}

namespace {

struct NearQuery {
  const SurfaceMesh* mesh;
  Vec3 p;
  double best_sq;
  std::uint32_t facet = kNoFacet;
  bool first_suffices;
};

bool visit_near(RTCPointQueryFunctionArguments* args) {
  auto* query = static_cast<NearQuery*>(args->userPtr);
  if (query->first_suffices && query->facet != kNoFacet) return false;
  const FacetPoint point = closest_on_facet(query->mesh->facet(args->primID), query->p);
  const bool tie = point.distance_sq == query->best_sq && args->primID < query->facet;
  if (!(point.distance_sq < query->best_sq || tie)) return false;
  query->best_sq = point.distance_sq;
  query->facet = args->primID;
  if (query->first_suffices) {
    args->query->radius = 0.0f;
    return true;
  }
  // Shrinks the search radius to the result, rounded up.
  const float radius = std::nextafter(static_cast<float>(std::sqrt(point.distance_sq)), INFINITY);
  if (radius >= args->query->radius) return false;
  args->query->radius = radius;
  return true;
}

void point_query(RTCScene scene, const Vec3& p, double radius_mm, RTCPointQueryFunction visit,
                 void* query) noexcept {
  RTCPointQuery point;
  point.x = static_cast<float>(p.x());
  point.y = static_cast<float>(p.y());
  point.z = static_cast<float>(p.z());
  point.time = 0.0f;
  point.radius = static_cast<float>(radius_mm);
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  rtcPointQuery(scene, &point, &context, visit, query);
}

NearQuery run_near(RTCScene scene, const SurfaceMesh& mesh, const Vec3& p, double radius_mm, double slack_mm,
                   bool first_suffices) noexcept {
  NearQuery query{&mesh, p, radius_mm * radius_mm, kNoFacet, first_suffices};
  point_query(scene, p, radius_mm + slack_mm, visit_near, &query);
  return query;
}

struct GatherQuery {
  const SurfaceMesh* mesh;
  Vec3 p;
  double radius_sq;
  std::span<NearFacet> found;
  std::size_t count = 0;
};

bool visit_gather(RTCPointQueryFunctionArguments* args) {
  auto* query = static_cast<GatherQuery*>(args->userPtr);
  if (query->count > query->found.size()) return false;
  const double distance_sq = closest_on_facet(query->mesh->facet(args->primID), query->p).distance_sq;
  if (distance_sq > query->radius_sq) return false;
  if (query->count < query->found.size()) query->found[query->count] = {std::sqrt(distance_sq), args->primID};
  if (++query->count <= query->found.size()) return false;
  args->query->radius = 0.0f;  // too many: ends the search
  return true;
}

}  // namespace

std::size_t SegmentIndex::gather(const Vec3& p, double radius_mm, std::span<NearFacet> found) const noexcept {
  if (!state_->clip_box.grown(radius_mm).contains(p)) return 0;
  GatherQuery query{state_->mesh, p, radius_mm * radius_mm, found};
  point_query(state_->scene, p, radius_mm + margin_mm(), visit_gather, &query);
  return query.count;
}

bool SegmentIndex::within(const Vec3& p, double radius_mm) const noexcept {
  if (!state_->clip_box.grown(radius_mm).contains(p)) return false;
  return run_near(state_->scene, *state_->mesh, p, radius_mm, margin_mm(), true).facet != kNoFacet;
}

std::uint32_t SegmentIndex::nearest(const Vec3& p, double max_radius_mm) const noexcept {
  return run_near(state_->scene, *state_->mesh, p, max_radius_mm, margin_mm(), false).facet;
}

double SegmentIndex::margin_mm() const noexcept {
  return kMarginQuanta * state_->quantum_mm;
}
std::size_t SegmentIndex::bytes() const noexcept {
  return static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, state_->bytes.load())) +
         state_->vertices.capacity() * sizeof(float) + state_->corners.capacity() * sizeof(std::uint32_t);
}

namespace {

/// Places a chunk for parallel work; sums are formed per chunk.
constexpr std::size_t kPlacesPerChunk = 4096;

}  // namespace

MeshGap gap_to(const SurfaceMesh& mesh, const SegmentIndex& index, std::span<const Vec3> places,
               int threads) {
  struct Part {
    double sum_sq = 0.0, most_sq = 0.0;
  };
  const geometry::Aabb& box = mesh.local_box_mm();
  const auto measure = [&](std::size_t i, Part& part) {
    const Vec3 p = places[i] - mesh.origin_mm();
    const double reach = (p - box.centre_mm()).norm() + box.extent_mm().norm();
    const std::uint32_t facet = index.nearest(p, reach);
    if (facet == kNoFacet) return;
    const double distance_sq = closest_on_facet(mesh.facet(facet), p).distance_sq;
    part.sum_sq += distance_sq;
    part.most_sq = std::max(part.most_sq, distance_sq);
  };
  Part all;
  for (const Part& part : parallel_parts<Part>(places.size(), kPlacesPerChunk, threads, measure)) {
    all.sum_sq += part.sum_sq;
    all.most_sq = std::max(all.most_sq, part.most_sq);
  }
  const double count = static_cast<double>(std::max<std::size_t>(places.size(), 1));
  return {std::sqrt(all.sum_sq / count), std::sqrt(all.most_sq), places.size()};
}

}  // namespace palpate::baselines
