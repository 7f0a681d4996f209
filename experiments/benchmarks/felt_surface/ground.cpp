#include "experiments/benchmarks/felt_surface/ground.h"

#include <fmt/format.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <numbers>

#include <palpate/accuracy.h>
#include <palpate/generate.h>
#include <palpate/paths.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "baselines/reference/mesh_reference.h"
#include "toolkit/core/random.h"
#include "toolkit/geometry/triangle_meshes.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::felt {
namespace {

constexpr std::uint64_t kSeed = 11;
/// Scans are scaled to hand size, with so many points, fewer with --quick.
constexpr double kScanMm = 150.0;
constexpr std::size_t kScanPoints = 300'000, kQuickScanPoints = 60'000;

void add_point(trace::ProbePath& path, const Vec3& hip) {
  path.t_s.push_back(kStepS * static_cast<double>(path.t_s.size()));
  path.hip_mm.push_back(hip);
}

/// Continues straight at the probe's speed.
void go_to(trace::ProbePath& path, const Vec3& to) {
  const Vec3 from = path.hip_mm.back();
  const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / (kSpeedMmS * kStepS))));
  for (int i = 1; i <= steps; ++i) add_point(path, from + (to - from) * (static_cast<double>(i) / steps));
}

/// Presses on the wall beside the equator, slides into the mouth and to the centre, and waits.
trace::ProbePath mouth_path(double radius, double rim_deg) {
  constexpr double kFromDeg = 100.0, kBeyondDeg = 12.0, kPressedMm = 1.0;
  constexpr int kWaitFrames = 500;
  const auto at = [](double deg, double r) {
    const double angle = deg * std::numbers::pi / 180.0;
    return Vec3(r * std::sin(angle), 0.0, -r * std::cos(angle));
  };
  trace::ProbePath path;
  path.name = "mouth";
  for (const double turn : {0.3, 0.7, 1.1}) {
    const Eigen::AngleAxisd about(turn, Vec3::UnitZ());
    const auto placed = [&](double deg, double r) { return Vec3(about * at(deg, r)); };
    if (path.t_s.empty())
      add_point(path, placed(kFromDeg, radius + kClearanceMm));
    else
      go_to(path, placed(kFromDeg, radius + kClearanceMm));
    go_to(path, placed(kFromDeg, radius - kPressedMm));
    for (double deg = kFromDeg; deg <= rim_deg + kBeyondDeg; deg += 0.5)
      go_to(path, placed(deg, radius - kPressedMm));
    go_to(path, Vec3::Zero());
    for (int i = 0; i < kWaitFrames; ++i) add_point(path, Vec3::Zero());
    go_to(path, Vec3(0.0, 0.0, radius + 2.0));
    go_to(path, placed(rim_deg, radius + 2.0));
  }
  return path;
}

/// Passes down beside the border of a square sheet, along it, and up; on all four sides.
trace::ProbePath border_path(double half) {
  constexpr double kBesideMm = 0.6, kBelowMm = 0.2, kAboveMm = 1.0;
  trace::ProbePath path;
  path.name = "border";
  for (int side = 0; side < 4; ++side) {
    const Eigen::AngleAxisd about(0.5 * std::numbers::pi * side, Vec3::UnitZ());
    const auto at = [&](double along, double z) { return Vec3(about * Vec3(half + kBesideMm, along, z)); };
    if (path.t_s.empty())
      add_point(path, at(-0.8 * half, kAboveMm));
    else
      go_to(path, at(-0.8 * half, kAboveMm));
    go_to(path, at(-0.8 * half, -kBelowMm));
    go_to(path, at(0.8 * half, -kBelowMm));
    go_to(path, at(0.8 * half, kAboveMm));
  }
  return path;
}

/// Presses beside a roof's ridge, slides along one face, lifts, then crosses the ridge near its tip. At
/// random places.
trace::ProbePath ridge_path(double half, std::size_t frames, std::uint64_t seed) {
  constexpr double kAsideMm = 2.5, kAlongMm = 3.0, kTipShare = 0.25;
  Random random(kSeed + seed);
  trace::ProbePath path;
  path.name = "ridge";
  add_point(path, {-0.5 * half, 0.0, kClearanceMm});
  while (path.t_s.size() < frames) {
    const double side = random.uniform() < 0.5 ? -1.0 : 1.0, depth = random.uniform(0.0, kDepthMm);
    const double x = side * random.uniform(0.0, kAsideMm), x_end = side * random.uniform(0.0, kAsideMm);
    const double y = random.uniform(-0.8, 0.8) * half, y_end = y + random.uniform(-kAlongMm, kAlongMm);
    go_to(path, {x, y, kClearanceMm});
    go_to(path, {x, y, -std::abs(x) - depth});
    go_to(path, {x_end, y_end, -std::abs(x_end) - depth});
    go_to(path, {x_end, y_end, kClearanceMm});
    const double tip = kTipShare * depth;
    go_to(path, {-side * kAsideMm, y_end, -tip});
    go_to(path, {side * kAsideMm, y, -tip});
    go_to(path, {side * kAsideMm, y, kClearanceMm});
  }
  path.t_s.resize(frames);
  path.hip_mm.resize(frames);
  return path;
}

constexpr double kCornerHalfMm = 12.0;
constexpr std::size_t kCornerPoints = 60'000, kQuickCornerPoints = 15'000;
constexpr int kCornerStrokes = 200;

/// Random points on a floor, z = 0, and a wall, x = 0, without common points. The wall continues below the
/// floor by a share of its half.
cloud::Cloud corner_points(double below, std::size_t count, std::uint64_t seed) {
  Random random(kSeed + seed);
  const double wall = 0.5 * (1.0 + below);  // its area over the floor's
  std::vector<Vec3> points;
  while (points.size() < count) {
    const bool on_wall = random.uniform() * (1.0 + wall) < wall;
    const double a = random.uniform(-1.0, 1.0), b = random.uniform(-1.0, 1.0),
                 c = random.uniform(-below, 1.0);
    points.push_back(kCornerHalfMm * (on_wall ? Vec3{0.0, a, c} : Vec3{b, a, 0.0}));
  }
  return cloud::build_cloud(points, cloud::NonFinite::kDrop).value();
}

/// Enters the corner from the quarter space between floor and wall, slides along it, and returns.
trace::ProbePath corner_path(std::uint64_t seed) {
  constexpr double kAlongMm = 1.0;
  Random random(kSeed + seed);
  trace::ProbePath path;
  path.name = "corner";
  add_point(path, {kClearanceMm, 0.0, kClearanceMm});
  for (int stroke = 0; stroke < kCornerStrokes; ++stroke) {
    const double y = random.uniform(-0.7, 0.7) * kCornerHalfMm,
                 y_end = y + random.uniform(-kAlongMm, kAlongMm);
    const double x = random.uniform(0.1, 1.0) * kDepthMm, z = random.uniform(0.1, 1.0) * kDepthMm;
    go_to(path, {kClearanceMm, y, kClearanceMm});
    go_to(path, {-x, y, -z});
    go_to(path, {-x, y_end, -z});
    go_to(path, {kClearanceMm, y_end, kClearanceMm});
  }
  return path;
}

/// Both hold the HIP: it is never behind either.
trace::ReferenceTrace corner_reference(const trace::ProbePath& path) {
  trace::ReferenceTrace reference;
  reference.name = "corner";
  reference.exactness = "a quarter space";
  for (const Vec3& hip : path.hip_mm) {
    trace::TruthFrame frame;
    frame.frame.god_object_mm = Vec3{std::max(hip.x(), 0.0), hip.y(), std::max(hip.z(), 0.0)};
    frame.frame.force_n = kStiffness * (frame.frame.god_object_mm - hip);
    frame.frame.contact = frame.frame.god_object_mm != hip;
    frame.frame.model = frame.frame.contact ? 0 : -1;
    frame.signed_distance_mm = std::min(hip.x(), hip.z());
    reference.frames.push_back(frame);
  }
  return reference;
}

/// No contact; distances are to the square |x|, |y| <= half at z = 0.
trace::ReferenceTrace free_reference(const trace::ProbePath& path, double half) {
  trace::ReferenceTrace reference;
  reference.name = "free";
  reference.exactness = "the path passes beside the sheet";
  for (const Vec3& hip : path.hip_mm) {
    trace::TruthFrame frame;
    frame.frame.god_object_mm = hip;
    const Vec3 nearest(std::clamp(hip.x(), -half, half), std::clamp(hip.y(), -half, half), 0.0);
    frame.signed_distance_mm = (hip - nearest).norm();
    reference.frames.push_back(frame);
  }
  return reference;
}

Result<trace::ProbePath> weave(const Ground& ground, std::size_t frames, std::uint64_t seed) {
  paths::PathTarget target;
  target.surface = ground.surface.get();
  target.cloud = &ground.points();
  target.mesh = ground.mesh.get();
  target.box_mm = ground.points().box_mm();
  target.spacing_mm = ground.spacing_mm;
  const std::string spec = fmt::format("weave:frames={}:speed_mm_s={}:depth_mm={}:clearance_mm={}:seed={}",
                                       frames, kSpeedMmS, kDepthMm, kClearanceMm, 1 + seed);
  return paths::make_path(parse_named_options(spec).value(), target);
}

/// Random points on the faces, uniform by area, with noise along the normals.
cloud::Cloud points_on_faces(const geometry::TriangleMesh& mesh, std::size_t count, double noise,
                             std::uint64_t seed) {
  const geometry::MeshSurfaceSampler picker(mesh);
  const double sigma = noise * std::sqrt(picker.area() / static_cast<double>(count));
  Random random(kSeed + seed);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < count; ++i) {
    const geometry::MeshSurfaceSampler::Pick place = picker.pick(random);
    points.push_back(place.point + random.normal() * sigma * picker.scaled_normal(place.facet).normalized());
  }
  return cloud::build_cloud(points, cloud::NonFinite::kDrop).value();
}

/// Reads a scan file; Error with gave_up if the data are absent.
Result<io::ReadModel> read_data(const std::string& file, Progress& progress) {
  const auto absent = [&](const std::string& why) {
    Error error{why, "set PALPATE_DATA to the folder of the scans", file};
    error.gave_up = true;
    return error;
  };
  const char* const data = std::getenv("PALPATE_DATA");
  if (data == nullptr) return absent("PALPATE_DATA is not set");
  std::error_code code;
  const std::filesystem::path path = std::filesystem::path(data) / file;
  if (!std::filesystem::exists(path, code)) return absent("this scan is not there");
  io::Readers readers;
  io::add_standard_readers(readers);
  io::ReadOptions options;
  options.unit = io::Unit::kMillimetre;  // any unit, but the same for a mesh and its raw points
  return readers.read(path.string(), options, progress);
}

/// Transforms a scan to hand size about the origin.
struct HandFrame {
  Vec3 middle = Vec3::Zero();
  double scale = 1.0;
  [[nodiscard]] Vec3 operator()(const Vec3& p) const { return (p - middle) * scale; }
};

/// The scan's mesh in its hand frame.
Result<std::shared_ptr<const geometry::TriangleMesh>> read_scan(const std::string& file, HandFrame& frame,
                                                                Progress& progress) {
  PALPATE_ASSIGN(const io::ReadModel read, read_data(file, progress));
  if (read.mesh == nullptr) return Error{"this scan has no faces", {}, file};
  auto mesh = std::make_shared<geometry::TriangleMesh>(*read.mesh);
  geometry::Aabb box;
  for (const Vec3& p : mesh->vertices_mm) box.add(p);
  frame = {box.centre_mm(), kScanMm / box.extent_mm().maxCoeff()};
  for (Vec3& p : mesh->vertices_mm) p = frame(p);
  return std::shared_ptr<const geometry::TriangleMesh>(std::move(mesh));
}

/// Raw points of a scan's mesh; a subset with --quick.
Result<cloud::Cloud> read_raw(const std::string& file, const HandFrame& frame, bool quick,
                              Progress& progress) {
  PALPATE_ASSIGN(const io::ReadModel read, read_data(file, progress));
  const std::size_t stride = quick ? std::max<std::size_t>(read.cloud.size() / kQuickScanPoints, 1) : 1;
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < read.cloud.size(); i += stride) points.push_back(frame(read.cloud.point_mm(i)));
  return cloud::build_cloud(points, cloud::NonFinite::kDrop);
}

void add_model(Ground& ground, const std::string& name, cloud::Cloud&& points) {
  render::ModelInput model;
  model.name = name;
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(points));
  model.surface.stiffness_n_per_mm = kStiffness;
  ground.scene.models.push_back(std::move(model));
}

Status add_scan_truth(Ground& ground, std::size_t frames, std::uint64_t seed, Progress& progress) {
  PALPATE_ASSIGN(auto truth, baselines::MeshTruth::build(*ground.mesh, {}));
  PALPATE_ASSIGN(ground.path, weave(ground, frames, seed));
  PALPATE_ASSIGN(ground.reference, baselines::mesh_reference(*truth, ground.path, kStiffness, 0.0, progress));
  ground.truth = std::move(truth);
  return Done{};
}

Status add_formula_truth(Ground& ground, const DataSet& set, std::size_t frames) {
  const geometry::Aabb box = ground.surface->box_mm();
  if (set.stroke == Stroke::kBorder) {
    ground.path = border_path(box.high_mm.x());
    ground.reference = free_reference(ground.path, box.high_mm.x());
    return Done{};
  }
  if (set.stroke == Stroke::kMouth) {
    const double radius = -box.low_mm.z(),
                 rim_deg = std::acos(-box.high_mm.z() / radius) * 180.0 / std::numbers::pi;
    ground.path = mouth_path(radius, rim_deg);
  } else if (set.stroke == Stroke::kRidge) {
    ground.path = ridge_path(box.high_mm.x(), frames, set.seed);
  } else {
    PALPATE_ASSIGN(ground.path, weave(ground, frames, set.seed));
  }
  metrics::ReferenceOptions options;
  options.check_halving = false;
  PALPATE_ASSIGN(ground.reference,
                 metrics::analytic_reference(*ground.surface, ground.path, kStiffness, 0.0, {}, options));
  ground.truth = std::make_unique<metrics::AnalyticTruth>(*ground.surface, geometry::RigidTransform{});
  return Done{};
}

/// Distance below which places coincide: far above rounding, far below perception.
constexpr double kSamePlace = 1e-6;

void find_caught(Ground& ground) {
  ground.caught.assign(ground.path.size(), 0);
  if (ground.truth == nullptr) return;
  for (std::size_t i = 0; i < ground.path.size(); ++i) {
    const trace::TruthFrame& truth = ground.reference.frames[i];
    if (!truth.frame.contact) continue;
    const Vec3& hip = ground.path.hip_mm[i];
    const double depth = (truth.frame.god_object_mm - hip).norm();
    ground.caught[i] = std::abs(ground.truth->signed_distance_mm(hip)) < (1.0 - kSamePlace) * depth;
  }
}

}  // namespace

Result<Ground> make_ground(const DataSet& set, bool quick, std::size_t frames, Progress& progress) {
  Ground ground;
  if (set.is_scan) {
    HandFrame frame;
    PALPATE_ASSIGN(ground.mesh, read_scan(set.generate, frame, progress));
    if (set.raw.empty()) {
      add_model(ground, set.name,
                points_on_faces(*ground.mesh, quick ? kQuickScanPoints : kScanPoints, set.noise, set.seed));
    } else {
      PALPATE_ASSIGN(cloud::Cloud raw, read_raw(set.raw, frame, quick, progress));
      add_model(ground, set.name, std::move(raw));
    }
  } else if (set.stroke == Stroke::kCorner) {
    const double below = read_number(set.generate, {0.0, 1.0}).value();
    add_model(ground, set.name, corner_points(below, quick ? kQuickCornerPoints : kCornerPoints, set.seed));
    ground.path = corner_path(set.seed);
    ground.reference = corner_reference(ground.path);
  } else {
    PALPATE_ASSIGN(const NamedOptions generator, parse_named_options(quick ? set.quick : set.generate));
    PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(generator));
    ground.surface = made.surface;
    add_model(ground, set.name, std::move(made.cloud));
  }
  const search::NeighbourTable nearest = search::exact_knn(ground.points(), 0);
  ground.spacing_mm = search::describe_spacing(ground.points(), nearest).nearest_mm.p50;
  if (set.is_scan) PALPATE_TRY(add_scan_truth(ground, frames, set.seed, progress));
  if (ground.surface != nullptr) PALPATE_TRY(add_formula_truth(ground, set, frames));
  PALPATE_TRY(metrics::fill_local_resolution(ground.reference, ground.path, ground.points(), nearest, {}));
  find_caught(ground);
  return ground;
}

std::vector<trace::ProbePath> closed_loops(const Ground& ground, std::size_t count) {
  std::vector<trace::ProbePath> loops;
  if (ground.surface == nullptr || ground.reference.name == "free") return loops;
  constexpr double kTwoPi = 2.0 * std::numbers::pi;
  constexpr int kPieces = 4096;  // for measuring a loop's length
  Random random(kSeed);
  while (loops.size() < count) {
    // Follows a closed curve of two frequencies in parameter space, repeatedly in and out.
    const double u = random.uniform(0.3, 0.7), v = random.uniform(0.3, 0.7),
                 wide = random.uniform(0.02, 0.15);
    const double phase = random.uniform(0.0, kTwoPi), other = random.uniform(0.0, kTwoPi);
    const auto turns = static_cast<double>(1 + random.below(3)),
               dips = static_cast<double>(1 + random.below(3));
    const double depth = random.uniform(0.3, 1.0) * kDepthMm;
    const auto hip = [&](double s) -> Vec3 {
      const auto at = ground.surface->at(u + wide * std::cos(kTwoPi * s + phase),
                                         v + wide * std::sin(kTwoPi * turns * s + other));
      const double lift =
          0.5 * (depth + kClearanceMm) * std::cos(kTwoPi * dips * s) - 0.5 * (depth - kClearanceMm);
      return at.point_mm + lift * at.normal;
    };
    // The probe continues straight across jumps of the normal.
    std::vector<Vec3> places = {hip(0.0)};
    std::vector<double> length = {0.0};
    for (int i = 1; i <= kPieces; ++i) {
      places.push_back(i == kPieces ? places.front() : hip(static_cast<double>(i) / kPieces));
      length.push_back(length.back() + (places.back() - *(places.end() - 2)).norm());
    }
    const double step = kSpeedMmS * kStepS;
    const auto frames = static_cast<std::size_t>(std::ceil(length.back() / step));
    trace::ProbePath path;
    path.name = fmt::format("loop {}", loops.size());
    for (std::size_t k = 0; k <= frames; ++k) {
      const double way = length.back() * static_cast<double>(k) / static_cast<double>(frames);
      const auto next = std::upper_bound(length.begin() + 1, length.end() - 1, way);
      const auto i = static_cast<std::size_t>(next - length.begin());
      const double part =
          length[i] > length[i - 1] ? (way - length[i - 1]) / (length[i] - length[i - 1]) : 0.0;
      add_point(path,
                k == frames ? places.front() : Vec3(places[i - 1] + part * (places[i] - places[i - 1])));
    }
    loops.push_back(std::move(path));
  }
  return loops;
}

}  // namespace palpate::felt
