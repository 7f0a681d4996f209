#include "experiments/hunt/trial.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <palpate/generate.h>
#include <palpate/renderer.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include <palpate/scene.h>
#include "experiments/run/stage.h"
#include "toolkit/metrics/scores.h"

namespace palpate::experiments {
namespace {

/// Distance from a border within which a surface may end: random points leave gaps of some three spacings.
constexpr double kBorderSpacings = 4.0;
/// Least width of a part in depths of the press. A round part's depth is half its radius, and its other sides
/// stay away.
constexpr double kFewestDepths = 4.0;
/// A touch lasts at least a tenth of a second.
constexpr std::size_t kFewestHandFrames = 100;

/// Lower bound on the distance to the surface's border; infinite without one.
double to_border_mm(const TrialInput& trial_input, const geometry::Aabb& box, const Vec3& p) {
  if (!trial_input.open()) return std::numeric_limits<double>::infinity();
  return std::min(
      {p.x() - box.low_mm.x(), box.high_mm.x() - p.x(), p.y() - box.low_mm.y(), box.high_mm.y() - p.y()});
}

Error not_judged(const char* what) {
  return {what, "take another trial_input", {}, 0};
}

/// The path of trial_input.hand on the exact shape with its truth. Both end where the true god object nears
/// an open surface's border, beyond which only the formula continues. Error: a shape too fine for its points
/// or the press, or a hand soon at a border.
Result<HuntScene> make_hand_scene(const TrialInput& trial_input) {
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(trial_input.model_text()));
  PALPATE_ASSIGN(const std::string text, hand_scene_toml(trial_input));
  StageRequest request;
  request.scene_name = "hunted";
  PALPATE_ASSIGN(request.scene, scene::parse_scene(text, request.scene_name));
  request.path = trial_input.hand->path_text();
  request.threads = request.load.threads = 1;
  PALPATE_ASSIGN(const cloud::GeneratedModel made, cloud::generate(named));
  if (trial_input.shape == "bowl") return not_judged("points do not tell from which side a sheet is felt");
  const double depth_mm = trial_input.hand->force_n / kHuntedStiffness;
  const Vec3 extent_mm = made.cloud.box_mm().extent_mm();
  const double width_mm = trial_input.open() ? std::min(extent_mm.x(), extent_mm.y()) : extent_mm.minCoeff();
  if (std::min(trial_input.finest_mm(), width_mm) <
      std::max(kFinestSpacings * made.nominal_spacing_mm, kFewestDepths * depth_mm))
    return not_judged("the shape is finer than its points or the press can tell");
  PALPATE_ASSIGN(Stage stage, set_up(request, io::Readers(), no_progress()));
  HuntScene scene;
  scene.input = std::move(stage.scene.input);
  scene.path = std::move(stage.path);
  scene.spacing_mm = made.nominal_spacing_mm;
  scene.truth = std::move(*stage.reference);
  const geometry::Aabb box = scene.input.models[0].cloud->box_mm();
  const auto at_border =
      std::find_if(scene.truth->frames.begin(), scene.truth->frames.end(), [&](const trace::TruthFrame& f) {
        return f.frame.contact &&
               to_border_mm(trial_input, box, f.frame.god_object_mm) < kBorderSpacings * scene.spacing_mm;
      });
  const auto kept = static_cast<std::size_t>(at_border - scene.truth->frames.begin());
  if (kept < kFewestHandFrames) return not_judged("the hand is soon at a border");
  scene.truth->frames.resize(kept);
  scene.path.t_s.resize(kept);
  scene.path.hip_mm.resize(kept);
  return scene;
}

}  // namespace

std::string toml_lines(const Options& options) {
  std::string text;
  for (const auto& [key, value] : options.all()) {
    const bool bare = parse_number(value).ok() || value == "true" || value == "false";
    text += bare ? fmt::format("{} = {}\n", key, value) : fmt::format("{} = \"{}\"\n", key, value);
  }
  return text;
}

std::string surface_toml(const TrialInput& trial_input) {
  std::string text = fmt::format("  [model.surface]\n  stiffness_n_per_mm = {}\n", kHuntedStiffness);
  if (trial_input.friction > 0.0) text += fmt::format("  friction = {:.17g}\n", trial_input.friction);
  return text;
}

Result<std::string> hand_scene_toml(const TrialInput& trial_input) {
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(trial_input.model_text()));
  return fmt::format("[[model]]\ngenerate = \"{}\"\n", named.name) + toml_lines(named.options) +
         surface_toml(trial_input);
}

namespace {

constexpr double kPeriodS = 1e-3;
/// Least move, as a share of the spacing, for judging a jump.
constexpr double kLeastMove = 1e-4;
/// Clearance from a surface in spacings and in noise lengths. Facets and fits are within an edge's sagitta,
/// vertex boxes within a resolution, plus a margin for strokes.
constexpr double kClearSpacings = 4.0, kClearNoise = 6.0;
/// Share of an open surface's width far from its border.
constexpr double kWithin = 0.75;
/// Estimated instructions per count: a move examines a facet and its neighbours, a test one facet.
constexpr double kPerStep = 150.0, kPerTest = 60.0, kPerCell = 60.0;

std::size_t index_of(double share, std::size_t size) {
  return std::min(static_cast<std::size_t>(share * static_cast<double>(size)), size - 1);
}

void edit(std::vector<Vec3>& points, const PointEdit& change, double spacing_mm) {
  if (points.empty()) return;
  const std::size_t i = index_of(change.which, points.size());
  switch (change.kind) {
    case PointEdit::Kind::kMove:
      points[i] += spacing_mm * change.by;
      break;
    case PointEdit::Kind::kDouble:
      points.push_back(points[i] + spacing_mm * change.by);
      break;
    case PointEdit::Kind::kDrop:
      points.erase(points.begin() + static_cast<std::ptrdiff_t>(i));
      break;
    case PointEdit::Kind::kOnto:
      points[i] = points[index_of(change.other, points.size())];
      break;
  }
}

Vec3 place_of(const Waypoint& to, const cloud::Cloud& cloud, const geometry::Aabb& box, double spacing_mm) {
  if (to.kind == Waypoint::Kind::kFree)
    return box.centre_mm() + (0.5 * box.extent_mm().cwiseMax(spacing_mm)).cwiseProduct(to.at);
  const Vec3 p = cloud.point_mm(index_of(to.which, cloud.size()));
  const Vec3 from = to.kind == Waypoint::Kind::kAtPoint
                        ? p
                        : Vec3(0.5 * (p + cloud.point_mm(index_of(to.other, cloud.size()))));
  return from + spacing_mm * to.at;
}

trace::ProbePath path_of(const TrialInput& trial_input, const cloud::Cloud& cloud, double spacing_mm) {
  const geometry::Aabb box = cloud.box_mm();
  constexpr double kAbove = 1.5;
  const Vec3 start = box.centre_mm() + Vec3{0.0, 0.0, kAbove * box.extent_mm().norm() + 4.0 * spacing_mm};
  trace::ProbePath path;
  path.name = "hunted";
  Vec3 at = start;
  const auto add = [&](const Vec3& p) {
    path.t_s.push_back(kPeriodS * static_cast<double>(path.size()));
    path.hip_mm.push_back(p);
  };
  const auto go = [&](const Vec3& to, int frames) {
    for (int k = 1; k <= frames && path.size() < kMostFrames; ++k)
      add(k == frames ? to : Vec3(at + (to - at) * (static_cast<double>(k) / frames)));
    at = to;
  };
  add(start);
  for (const Waypoint& to : trial_input.way) go(place_of(to, cloud, box, spacing_mm), to.frames);
  constexpr int kBack = 20, kRest = 30;
  for (int k = 0; k < kBack + kRest; ++k)
    add(k >= kBack ? start : Vec3(at + (start - at) * (static_cast<double>(k + 1) / kBack)));
  return path;
}

void keep_worst(Worst& worst, double score, std::size_t frame) {
  if (score > worst.score) worst = {score, frame};
}

/// The promise a frame breaks; empty if none.
std::string broken(const render::Frame& frame) {
  if (!is_finite(frame.force_n)) return "the force is not finite";
  if (!is_finite(frame.god_object_mm)) return "the god object is not finite";
  if (frame.status == render::FrameStatus::kNonFinite) return "a finite HIP is called non-finite";
  if (!frame.contact && frame.force_n != Vec3::Zero()) return "a force without contact";
  return {};
}

/// True if the place is within the middle of an open surface.
bool within(const HuntScene& scene, const Vec3& h) {
  const geometry::Aabb box = scene.input.models[0].cloud->box_mm();
  const Vec3 off = (h - box.centre_mm()).cwiseAbs(), half = 0.5 * kWithin * box.extent_mm();
  return off.x() <= half.x() && off.y() <= half.y();
}

/// `doubtful`: preparation warned of the answers.
void judge(const HuntScene& scene, bool doubtful, const std::vector<render::Frame>& frames, Trial& trial) {
  const auto& h = scene.path.hip_mm;
  // The first frame's HIP is free at its place.
  Vec3 god_before = h[0];
  double made = 0.0, stored = 0.0;
  std::size_t made_most_at = 0, stuck = 0, stuck_at = 0;
  double made_most = 0.0, way = 0.0;  // the HIP's path length since it was free
  const double friction = scene.input.models[0].surface.friction.static_coefficient;
  const bool frictionless = friction == 0.0;
  const double cone = std::sqrt(1.0 + friction * friction);  // the pull, enlarged by friction
  bool known = scene.surface != nullptr && !doubtful;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const render::Frame& f = frames[k];
    if (trial.fault.empty()) {
      const std::string what = broken(f);
      if (!what.empty()) trial.fault = fmt::format("frame {}: {}", k, what);
    }
    trial.bound_hits += f.status == render::FrameStatus::kBoundHit;
    known = known && (!scene.open || within(scene, h[k]));
    // A god object only descends: ending farther from the HIP than if it had stayed creates energy.
    const double now = 0.5 * kHuntedStiffness * (h[k] - f.god_object_mm).squaredNorm();
    const double gained = now - 0.5 * kHuntedStiffness * (h[k] - god_before).squaredNorm();
    stored = std::max(stored, now);
    // With friction an anchor holds the god object, and the sum of squares is no potential.
    if (frictionless && f.contact && gained > 0.0) {
      made += gained;
      if (gained > made_most) {
        made_most = gained;
        made_most_at = k;
      }
    }
    god_before = f.contact ? f.god_object_mm : h[k];
    if (k > 0) way += (h[k] - h[k - 1]).norm();
    if (!f.contact) {
      way = 0.0;
      continue;
    }
    if (way > kLeastMove * scene.spacing_mm)
      keep_worst(trial.worst[static_cast<std::size_t>(HuntGoal::kForce)],
                 f.force_n.norm() / (cone * kHuntedStiffness * way), k);
    if (k > 0 && frames[k - 1].contact) {
      const double move = (h[k] - h[k - 1]).norm();
      if (move > kLeastMove * scene.spacing_mm)
        keep_worst(trial.worst[static_cast<std::size_t>(HuntGoal::kJump)],
                   (f.force_n - frames[k - 1].force_n).norm() / (kHuntedStiffness * move), k);
    }
    if (known && scene.surface->signed_distance_mm(h[k] - scene.offset_mm) > scene.clear_mm) {
      ++stuck;
      stuck_at = k;
    }
  }
  if (trial.fault.empty() && frames.back().status == render::FrameStatus::kBoundHit)
    trial.fault = "what was left for the next frame is not done after 30 frames of rest";
  if (stored > 0.0)
    keep_worst(trial.worst[static_cast<std::size_t>(HuntGoal::kEnergy)], made / stored, made_most_at);
  keep_worst(trial.worst[static_cast<std::size_t>(HuntGoal::kStick)], static_cast<double>(stuck), stuck_at);
}

void judge_hand(const HuntScene& scene, const std::vector<render::Frame>& frames, Trial& trial) {
  const metrics::ContactArtefacts wrong = metrics::find_artefacts(scene.path, frames, scene.truth->frames);
  const auto keep = [&](HuntGoal goal, double score, std::size_t frame) {
    keep_worst(trial.worst[static_cast<std::size_t>(goal)], score, frame);
  };
  keep(HuntGoal::kCaught, static_cast<double>(wrong.caught.frames), wrong.caught.longest_at);
  // Within a spacing, noise or a chord over an edge or gap may lie below the truth for any renderer.
  const double told_mm = std::max(metrics::kLostMm, scene.spacing_mm);
  if (metrics::find_artefacts(scene.path, frames, scene.truth->frames, told_mm).lost.frames > 0)
    keep(HuntGoal::kLost, static_cast<double>(wrong.lost.frames), wrong.lost.longest_at);
  keep(HuntGoal::kKick, wrong.kick_max_n, wrong.kick_max_at);
}

}  // namespace

const GoalInfo& info_of(HuntGoal goal) {
  static constexpr std::array<GoalInfo, kGoals> kInfos = {{
      {"work", "counted steps of one frame, weighed as instructions"},
      {"force", "force over cone times stiffness times the HIP's way since it was free: at most 1"},
      {"stick", "frames in contact while the formula has the HIP clear outside"},
      {"jump", "change of force over stiffness times move, within contact"},
      {"energy", "energy made by the god object over the largest stored: 0 where it only descends"},
      {"caught", "frames in which a hand is caught: the god object stays far from the true one"},
      {"lost", "frames in which a hand loses the surface: true contact without a force"},
      {"kick", "largest step of force that a hand feels above those of the truth, N"},
  }};
  return kInfos[static_cast<std::size_t>(goal)];
}

Result<HuntScene> make_scene(const TrialInput& trial_input) {
  if (trial_input.hand) return make_hand_scene(trial_input);
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(trial_input.model_text()));
  PALPATE_ASSIGN(const cloud::GeneratedModel made, cloud::generate(named));
  HuntScene scene;
  scene.spacing_mm = made.nominal_spacing_mm;
  const double size = made.cloud.box_mm().extent_mm().norm();
  scene.offset_mm = Vec3::Constant(trial_input.offset * size);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < made.cloud.size(); ++i) points.push_back(made.cloud.point_mm(i));
  for (const PointEdit& change : trial_input.edits) edit(points, change, scene.spacing_mm);
  for (Vec3& p : points) p += scene.offset_mm;
  PALPATE_ASSIGN(cloud::Cloud built, cloud::build_cloud(points, cloud::NonFinite::kRefuse));
  // Rebuilds from the stored points, which a file would hold.
  for (std::size_t i = 0; i < points.size(); ++i) points[i] = built.point_mm(i);
  PALPATE_ASSIGN(built, cloud::build_cloud(points, cloud::NonFinite::kRefuse));
  if (trial_input.keeps_raster()) built.raster = made.cloud.raster;
  render::ModelInput model;
  model.name = "hunted";
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(built));
  model.surface.stiffness_n_per_mm = kHuntedStiffness;
  model.surface.friction = {trial_input.friction, trial_input.friction};
  scene.path = path_of(trial_input, *model.cloud, scene.spacing_mm);
  const bool judged = std::min(trial_input.finest_mm(), size) > kFinestSpacings * scene.spacing_mm &&
                      trial_input.edits.empty() && !(trial_input.outliers > 0.0) &&
                      trial_input.shape != "bowl" && static_cast<double>(trial_input.points) >= kFewestJudged;
  if (judged) scene.surface = made.surface;
  scene.open = trial_input.open();
  scene.clear_mm = scene.spacing_mm * (kClearSpacings + kClearNoise * trial_input.noise);
  scene.input.models.push_back(std::move(model));
  return scene;
}

Result<Trial> try_scene(const HuntScene& scene, render::HapticRenderer& renderer) {
  PALPATE_ASSIGN(const render::PrepareReport prepared, renderer.prepare(scene.input, {1, nullptr}));
  Trial trial;
  PALPATE_ASSIGN(const trace::ForceTrace first, trace::replay(renderer, scene.path));
  // Replays frame by frame like replay(): a restart resets everything, and a frame's counts are its own work.
  trace::ForceTrace again;
  renderer.restart(scene.path.hip_mm[0], scene.path.t_s[0] - kPeriodS);
  render::FrameCounters before = renderer.counters();
  for (std::size_t k = 0; k < scene.path.size(); ++k) {
    again.frames.push_back(renderer.step(scene.path.hip_mm[k], scene.path.t_s[k]));
    const render::FrameCounters now = renderer.counters();
    const double work = kPerStep * static_cast<double>(now.walk_steps - before.walk_steps) +
                        kPerTest * static_cast<double>(now.box_tests - before.box_tests) +
                        kPerCell * static_cast<double>(now.cells_visited - before.cells_visited);
    keep_worst(trial.worst[static_cast<std::size_t>(HuntGoal::kWork)], work, k);
    before = now;
  }
  if (trace::trace_hash(first) != trace::trace_hash(again))
    trial.fault = "a second replay answers otherwise than the first";
  judge(scene, !prepared.warnings.empty(), first.frames, trial);
  if (scene.truth && prepared.warnings.empty()) judge_hand(scene, first.frames, trial);
  return trial;
}

}  // namespace palpate::experiments
