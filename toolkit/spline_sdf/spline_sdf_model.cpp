#include "toolkit/spline_sdf/spline_sdf_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include <palpate/model_store.h>
#include <palpate/result.h>
#include "toolkit/core/hardware.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"
#include "toolkit/render/prepare.h"
#include "toolkit/search/knn.h"
#include "toolkit/spline_sdf/build_bricks.h"
#include "toolkit/spline_sdf/fit_patches.h"
#include "toolkit/spline_sdf/morton_points.h"
#include "toolkit/spline_sdf/orient_patches.h"
#include "toolkit/spline_sdf/point_noise.h"
#include "toolkit/spline_sdf/spline.h"

namespace palpate::spline_sdf {

using namespace render;

namespace {

/// Properties are averaged over points within this many spacings of the surface below a corner, nearer ones
/// more; some thirty.
constexpr double kPropertySpacings = 3.0;
constexpr std::size_t kCornerGrain = 64;
/// Largest spline error in spacings: 0.005 N at 0.5 mm spacing and 0.5 N/mm.
constexpr double kFieldTolerance = 0.05;
/// Voxel size of a cloud without area; any value works.
constexpr double kAnyVoxel = 1.0;

/// Estimated bricks for N surface cubes, including those within a spacing; a sheet has about 4.6 sqrt(N)
/// along its border. Within a fifth on scenes of 100 to 10,000 cubes. Smaller bricks at edges, thin parts and
/// noise are known only after building. No decision uses it.
double bricks_of(double cubes) {
  return 1.4 * cubes + 4.6 * std::sqrt(cubes);
}

/// Estimated table size: blocks of four by four cubes of a sheet and its border, three slots each on average.
double table_bytes_of(double cubes) {
  constexpr double kSlotBytes = 24.0, kSlots = 3.0, kBlockEdge = 4.0;
  const double along = std::sqrt(cubes) / kBlockEdge + 1.0;
  return kSlots * kSlotBytes * along * along;
}

/// A tilted surface crosses about 1.5 times the cubes of an aligned one.
constexpr double kCubesAskew = 1.5;

/// A point with surroundings this empty, or without area, stands alone: no surface crosses its cube.
constexpr double kOutlierEdges = 3.0;

/// Log2 of the remembered cubes; kPointsPerChunk points are in about that many.
constexpr int kLastCubeBits = 9;

/// Estimated cubes of this edge that the surface crosses, from those with points: a cube expecting m points
/// is empty with probability exp(-m) (Poisson). O(n): points in Morton order rarely leave a cube.
std::uint64_t cubes_through(const MortonPoints& points, double edge_mm, int threads) {
  struct Stay {
    std::uint64_t code = 0;
    double points = 0.0, cubes = 0.0;  ///< sum over the points of each one's share of a cube
  };
  const Vec3 low = points.box_mm().low_mm;
  const auto visit = [&](std::size_t begin, std::size_t end, std::vector<Stay>& left) {
    // The curve soon returns to a cube and adds to what is remembered.
    std::vector<Stay> last(std::size_t{1} << kLastCubeBits);
    // Points of a cell have one spacing.
    double edges = 0.0, share = 0.0;
    const auto leave = [&](const Stay& stay) {
      if (stay.points > 0.0) left.push_back(stay);
    };
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3 cube = (points[i] - low) / edge_mm;
      const std::uint64_t code =
          search::morton_code(static_cast<std::uint32_t>(cube.x()), static_cast<std::uint32_t>(cube.y()),
                              static_cast<std::uint32_t>(cube.z()));
      Stay& stay = last[(code * kGolden64) >> (64 - kLastCubeBits)];
      if (stay.code != code) {
        leave(stay);
        stay = {code};
      }
      stay.points += 1.0;
      if (const double own = points.spacing_near(i) / edge_mm; own != edges) {
        edges = own;
        share = edges > 0.0 && edges <= kOutlierEdges ? 1.0 / std::expm1(-1.0 / (kCubesAskew * edges * edges))
                                                      : 0.0;
      }
      stay.cubes -= share;
    }
    for (const Stay& stay : last) leave(stay);
  };
  std::vector<Stay> stays = parallel_list<Stay>(points.size(), kPointsPerChunk, threads, visit);
  std::uint64_t codes = 0;
  for (const Stay& stay : stays) codes |= stay.code;
  radix_sort(stays, static_cast<int>(std::bit_width(codes)), threads, [](const Stay& s) { return s.code; });
  double sum = 0.0;
  for (std::size_t i = 0; i < stays.size();) {
    double held = 0.0, cubes = 0.0;
    const std::uint64_t code = stays[i].code;
    for (; i < stays.size() && stays[i].code == code; ++i) {
      held += stays[i].points;
      cubes += stays[i].cubes;
    }
    sum += cubes / held;
  }
  return static_cast<std::uint64_t>(sum);
}

SplineSdfDecision measure(const MortonPoints& points, const SplineSdfOptions& build, double noise_mm,
                          int threads) {
  SplineSdfDecision out;
  out.spacing_mm = points.spacing_mm();
  out.noise_mm = noise_mm;
  out.voxel_mm = out.spacing_mm > 0.0 ? build.voxel_spacings * out.spacing_mm : kAnyVoxel;
  // Far outliers: cubes beyond a code's bits per axis are not estimated.
  constexpr double kMaxCubes = 1 << search::kMortonBits;
  const double edge_mm = kBrickCells * out.voxel_mm;
  if (points.size() > 0 && points.box_mm().extent_mm().maxCoeff() < kMaxCubes * edge_mm)
    out.cubes = cubes_through(points, edge_mm, threads);
  return out;
}

/// Shares of sampled places from which the whole is doubtful. Two layers are felt as one anywhere; a tenth of
/// a scan's places may be noise in the air.
constexpr double kDoubtfulLayers = 0.05, kDoubtfulVolume = 0.25;

void warn_of(const InputQuality& quality, PreparePhases& phases) {
  if (quality.layered > kDoubtfulLayers)
    phases.warn(fmt::format(
        "At {:.0f} % of the places looked at the points lie in two layers some {:.3g} mm apart, too "
        "near to be told apart everywhere: there they are felt as one sheet that either side may hold. "
        "If they are the faces of a thin wall, only a denser or less noisy scan separates them.",
        100.0 * quality.layered, quality.layer_distance_mm));
  if (quality.scattered > kDoubtfulVolume)
    phases.warn(fmt::format(
        "At {:.0f} % of the places looked at the points fill a volume: there is no surface to "
        "follow, and what is felt has no certain side. Give the points of a surface, or clean them "
        "(palpate clean).",
        100.0 * quality.scattered));
}

Result<std::shared_ptr<const SplineSdf>> build_surface(const cloud::Cloud& cloud,
                                                       const SplineSdfOptions& build,
                                                       const PrepareContext& context, PrepareReport& report) {
  PreparePhases phases(report, context);
  phases.begin("sort and spacing");
  MortonPoints points(cloud, context.threads);
  points.drop_order();
  phases.end();
  phases.begin("noise");
  const NoiseField noise(points, context.threads);
  const SplineSdfDecision measured = measure(points, build, noise.median(), context.threads);
  if (measured.spacing_mm > 0.0)
    warn_of(assess_input_quality(points, measured.noise_mm, context.threads), phases);
  phases.end();
  auto out = std::make_shared<SplineSdf>();
  out->spacing_mm = measured.spacing_mm;
  out->noise_mm = measured.noise_mm;
  out->cubes = measured.cubes;
  phases.begin("patches");
  FittedPatches cover;
  if (measured.spacing_mm > 0.0) cover = fit_patches(points, {build.detail, noise}, context.threads);
  drop_outlier_patches(cover.patches, context.threads);
  phases.end();
  phases.begin("sides");
  const std::vector<std::uint32_t> piece = orient_outwards(points, cover.patches, context.threads).piece;
  out->patches = cover.patches.size();
  phases.end();
  phases.begin("bricks");
  return_freed_memory();  // of patches and links; most is held from here on
  std::vector<PointPatches> of_points = assign_patches(points, cover.patches, context.threads);
  out->grid = build_bricks(points, cover.patches, piece, std::move(of_points), brick_options(measured, build),
                           context.threads);
  phases.end();
  out->isolated_points = cover.isolated_points;
  report.bytes += out->grid.bytes();
  phases.note(fmt::format("smooth surface: {} patches in {} bricks, {} closed pieces; {} points stand alone",
                          out->patches, out->grid.bricks.size(), out->grid.closed_components.size(),
                          out->isolated_points));
  if (auto wide = wide_mouth_warning(out->grid.min_enclosed)) phases.warn(*std::move(wide));
  if (out->grid.bricks.empty())
    phases.warn("The points make no surface: nothing is felt. Check the file and its unit, or take cloud.");
  return std::shared_ptr<const SplineSdf>(std::move(out));
}

/// Values at a brick's cell corners, from points around the nearest place of the sheet.
class CornerValues {
 public:
  CornerValues(const MortonPoints& points, const SurfaceField& field, const SplineSdf& smooth)
      : points_(points), field_(field), grid_(smooth.grid), reach_(kPropertySpacings * smooth.spacing_mm) {}

  void fill(const Brick& brick, const BrickGrid::BrickRef& place_of, CornerProperties& out) {
    const double voxel_mm = grid_.voxel_mm / grid_.per_voxel_of(place_of.level);
    gather(place_of.cube, voxel_mm);
    for (int i = 0; i < kBrickCornerCount; ++i) {
      const std::array<int, 3> corner{i / (kBrickCorners * kBrickCorners), i / kBrickCorners % kBrickCorners,
                                      i % kBrickCorners};
      BrickPosition at;
      Vec3 place;
      for (std::size_t a = 0; a < 3; ++a) {
        at.cell[a] = std::min(corner[a], kBrickCells - 1);
        at.t[a] = static_cast<float>(corner[a] - at.cell[a]);
        place[static_cast<Eigen::Index>(a)] = corner[a] - 0.5 * kBrickCells;
      }
      const Jet jet = spline_jet(brick, at);
      const Vec3 g = jet.gradient.cast<double>();
      const double size_sq = g.squaredNorm();
      if (size_sq > 0.0) place -= g * (static_cast<double>(jet.value) / size_sq);
      out[static_cast<std::size_t>(i)] = mean_at(place * voxel_mm);
    }
  }

 private:
  void gather(const BrickGrid::Coordinate& cube, double voxel_mm) {
    near_.clear();
    const Vec3 middle =
        grid_.low_mm + (Vec3(cube[0], cube[1], cube[2]) + Vec3::Constant(0.5)) * (kBrickCells * voxel_mm);
    double radius = kHalfDiagonal * voxel_mm + reach_;
    // A brick between far points takes the nearest ones.
    for (int query = 0; near_.empty() && query < kWiderQueries; ++query, radius *= 2.0)
      points_.in_ball(middle, radius, [&](std::uint32_t i, const Vec3& d, double) {
        near_.push_back({d, field_.by_point[points_.index(i)]});
      });
  }
  /// Shepard's mean: weights grow without bound at a point, so every place has a value.
  [[nodiscard]] PointSurface mean_at(const Vec3& place) const {
    double weights = 0.0, stiffness = 0.0, still = 0.0, moving = 0.0;
    const double per_sq = 1.0 / (reach_ * reach_);
    for (const Near& n : near_) {
      const double share = (n.at - place).squaredNorm() * per_sq + kNearest;
      const double weight = 1.0 / (share * share * share);
      weights += weight;
      stiffness += weight * static_cast<double>(n.value.stiffness_n_per_mm);
      still += weight * static_cast<double>(n.value.static_friction);
      moving += weight * static_cast<double>(n.value.dynamic_friction);
    }
    if (!(weights > 0.0)) return {static_cast<float>(field_.largest_stiffness_n_per_mm), 0.0f, 0.0f};
    const double per = 1.0 / weights;
    return {static_cast<float>(stiffness * per), static_cast<float>(still * per),
            static_cast<float>(moving * per)};
  }

  /// A coincident point weighs like one at a third of the reach, a spacing.
  static constexpr double kNearest = 1.0 / 9.0;
  static constexpr int kWiderQueries = 8;
  struct Near {
    Vec3 at;
    PointSurface value;
  };
  const MortonPoints& points_;
  const SurfaceField& field_;
  const BrickGrid& grid_;
  double reach_;
  std::vector<Near> near_;
};

void fill_corners(const ModelInput& input, SplineSdfBody& body, const PrepareContext& context) {
  const BrickGrid& grid = body.smooth->grid;
  const MortonPoints points(*input.cloud, context.threads);
  const std::vector<BrickGrid::BrickRef> places = grid.places();
  body.corners.resize(grid.bricks.size());
  parallel_chunks(grid.bricks.size(), kCornerGrain, context.threads, [&](std::size_t begin, std::size_t end) {
    CornerValues values(points, body.surface, *body.smooth);
    for (std::size_t b = begin; b < end; ++b) values.fill(grid.bricks[b], places[b], body.corners[b]);
  });
}

Status prepare_properties(const ModelInput& input, SplineSdfBody& body, const PrepareContext& context,
                          PrepareReport& report) {
  std::vector<std::uint32_t> order(input.cloud->size());
  std::iota(order.begin(), order.end(), 0u);
  PALPATE_ASSIGN(body.surface, build_surface_field(input, order, report));
  if (body.surface.by_point.empty()) return Done{};
  PreparePhases phases(report, context);
  phases.begin("properties");
  const double blend_mm = kBlendResolutions * body.smooth->spacing_mm;
  const search::NeighbourTable table = search::exact_knn(*input.cloud, context.threads);
  const std::size_t softer =
      blend_stiffness(body.surface, surface::surface_points(*input.cloud), table.of, blend_mm);
  fill_corners(input, body, context);
  release_memory(body.surface.by_point);
  phases.end();
  phases.note(fmt::format("stiffness blended over {:.3g} mm: {} points made softer", blend_mm, softer));
  report.bytes += body.corners.capacity() * sizeof(CornerProperties);
  return Done{};
}

}  // namespace

BrickBuildOptions brick_options(const SplineSdfDecision& measured, const SplineSdfOptions& build) {
  BrickBuildOptions out;
  out.voxel_mm = measured.voxel_mm;
  out.noise_mm = measured.noise_mm;
  out.tolerance_mm = kFieldTolerance * measured.spacing_mm;
  out.both_sides = build.both_sides;
  return out;
}

Result<SplineSdfDecision> decide_spline_sdf(const ModelInput& input, const SplineSdfOptions& build,
                                            const PrepareContext& context) {
  PALPATE_ASSIGN(SurfaceDecision surface, decide_surface(input));
  const MortonPoints points(*input.cloud, context.threads);
  SplineSdfDecision out = measure(points, build, estimate_noise(points, context.threads), context.threads);
  out.surface = std::move(surface);
  return out;
}

void describe_spline_sdf(const ModelInput& input, const SplineSdfOptions& build,
                         const SplineSdfDecision& decision, Features felt, ModelDecisions& out) {
  const double share = decision.spacing_mm > 0.0 ? decision.noise_mm / decision.spacing_mm : 0.0;
  out.name = input.name;
  out.points = input.cloud->size();
  out.spacing_mm = decision.spacing_mm;
  out.decisions.push_back(
      {"surface", "smooth, near the points",
       fmt::format("noise of {:.3g} spacings was measured; a deviation of {:.3g} standard errors "
                   "is taken for shape",
                   share, build.detail)});
  out.decisions.push_back(
      {"bricks", fmt::format("voxels of {:.3g} mm", decision.voxel_mm),
       fmt::format("{:.3g} times the spacing of {:.3g} mm; bytes are of a surface without edges: along "
                   "these stand up to twenty smaller ones for each",
                   build.voxel_spacings, decision.spacing_mm)});
  out.decisions.push_back(
      {"neighbours", "none stored", "the surface is a spline; no point is looked at in a frame"});
  describe_surface(input, decision.surface, felt, input.cloud->size(), out);
  const bool varied = (decision.surface.features & kVaried) != 0;
  const auto cubes = static_cast<double>(decision.cubes);
  const auto brick_bytes = static_cast<double>(sizeof(Brick) + sizeof(std::uint32_t) +
                                               (varied ? sizeof(CornerProperties) : std::size_t{0}));
  out.bytes = static_cast<std::uint64_t>(bricks_of(cubes) * brick_bytes + table_bytes_of(cubes));
  if (input.motion != nullptr)
    out.decisions.push_back({"motion", "pose read in each frame", "the scene moves it", true});
}

Result<std::shared_ptr<const SplineSdf>> build_spline_sdf(const cloud::Cloud& cloud,
                                                          const SplineSdfOptions& build,
                                                          const PrepareContext& context,
                                                          PrepareReport& report) {
  return get_or_build<SplineSdf>(
      context, report,
      [&] {
        return fmt::format("smooth {:016x} {} {} {} {}", cloud::content_hash(cloud), cloud.size(),
                           build.detail, build.voxel_spacings, build.both_sides);
      },
      [&](PrepareReport& to) { return build_surface(cloud, build, context, to); });
}

Result<SplineSdfBody> build_spline_sdf_body(const ModelInput& input, const SplineSdfOptions& build,
                                            const PrepareContext& context, PrepareReport& report) {
  const cloud::Cloud& cloud = *input.cloud;
  SplineSdfBody body;
  PALPATE_ASSIGN(body.smooth, build_spline_sdf(cloud, build, context, report));
  body.pose = ModelPose(input, cloud.origin_mm);
  PALPATE_TRY(prepare_properties(input, body, context, report));
  return body;
}

}  // namespace palpate::spline_sdf
