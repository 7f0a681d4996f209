#include "experiments/hunt/trial.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>

#include <palpate/accuracy.h>
#include <palpate/generate.h>

namespace palpate::experiments {
namespace {

constexpr std::array kShapes = {"sinusoid", "plane", "saddle",    "relief",      "wedge", "sphere", "pebble",
                                "torus",    "slab",  "ellipsoid", "rounded-box", "bowl",  "shells"};
constexpr std::array kSamplings = {"grid", "random", "blue", "grid"};
// Few points: failures with thousands also occur with hundreds, and a trial takes milliseconds.
constexpr double kFewestPoints = 16.0, kMostPoints = 4000.0;
constexpr double kLeastScale = 1e-3, kMostScale = 1e6;
constexpr int kMostEdits = 12, kMostWaypoints = 14, kSlowestLeg = 200;

/// Ranges of a shape's own options. `finest_mm`: size of the part controlled by the option, per unit of it,
/// at scale 1; 0: none. A crest is half a wave wide, a torus's tube 0.5 to 1 times its number. A ridge
/// sharper than a right angle is left by its other side while the truth still holds on the first.
struct FormRange {
  std::string_view shape;
  const char* key;
  double low, high;
  double finest_mm = 0.0;
};
constexpr FormRange kForms[] = {{"sinusoid", "amplitude_mm", 1.0, 5.0},
                                {"sinusoid", "wavelength_mm", 10.0, 100.0, 0.5},
                                {"relief", "finest_mm", 1.0, 50.0, 0.5},
                                {"relief", "slope", 0.05, 1.0},
                                {"wedge", "angle_deg", 90.0, 270.0},
                                {"pebble", "finest", 0.05, 1.0, 12.5},
                                {"pebble", "slope", 0.05, 0.6},
                                {"torus", "tube", 0.1, 0.8, 50.0},
                                {"slab", "thickness_mm", 1.0, 40.0, 1.0},
                                {"ellipsoid", "aspect_y", 0.1, 1.0, 60.0},
                                {"ellipsoid", "aspect_z", 0.1, 1.0, 60.0},
                                {"rounded-box", "aspect_y", 0.05, 1.0, 40.0},
                                {"rounded-box", "aspect_z", 0.05, 1.0, 40.0},
                                {"rounded-box", "radius_mm", 0.05, 10.0},
                                {"bowl", "rim_deg", 30.0, 160.0},
                                {"shells", "gap_mm", 0.6, 15.0, 1.0}};

template <class Kinds>
const char* one_of(const Kinds& kinds, Random& random) {
  return kinds[random.below(kinds.size())];
}
bool chance(Random& random, double share) {
  return random.uniform() < share;
}
double log_uniform(Random& random, double low, double high) {
  return low * std::exp(random.uniform() * std::log(high / low));
}
/// A vector of any order of magnitude up to `most`.
Vec3 any_vector(Random& random, double most) {
  constexpr double kSmallest = 1e-9;
  const Vec3 v{random.normal(), random.normal(), random.normal()};
  const double size = v.norm();
  return size > 0.0 ? Vec3(v * (log_uniform(random, kSmallest, 1.0) * most / size)) : Vec3::Zero();
}

PointEdit random_edit(Random& random) {
  PointEdit edit;
  constexpr std::uint64_t kKinds = 4;
  edit.kind = static_cast<PointEdit::Kind>(random.below(kKinds));
  edit.which = random.uniform();
  edit.other = random.uniform();
  constexpr double kFar = 30.0;
  edit.by = any_vector(random, kFar);
  return edit;
}

Waypoint random_waypoint(Random& random) {
  Waypoint to;
  constexpr std::uint64_t kKinds = 3;
  to.kind = static_cast<Waypoint::Kind>(random.below(kKinds));
  to.which = random.uniform();
  // Half of these are neighbours: adjacent points in the store are near in space.
  constexpr double kNeighbour = 0.01;
  to.other = chance(random, 0.5) ? std::fmod(to.which + kNeighbour, 1.0) : random.uniform();
  if (to.kind == Waypoint::Kind::kFree) {
    constexpr double kAround = 1.3;
    to.at = Vec3{random.uniform(-kAround, kAround), random.uniform(-kAround, kAround),
                 random.uniform(-kAround, kAround)};
  } else {
    constexpr double kNear = 4.0, kExactly = 0.3;
    to.at = chance(random, kExactly) ? Vec3::Zero() : any_vector(random, kNear);
  }
  to.frames = static_cast<int>(log_uniform(random, 1.0, kSlowestLeg));
  return to;
}

/// A value that the specification allows; numbers spread over some orders around the default.
std::string random_value(const OptionSpec& spec, Random& random) {
  switch (spec.kind) {
    case OptionKind::kChoice:
      return spec.choices[random.below(spec.choices.size())];
    case OptionKind::kFlag:
      return chance(random, 0.5) ? "true" : "false";
    case OptionKind::kInteger:
      return std::to_string(static_cast<long long>(
          spec.low + std::floor(random.uniform() * (std::min(spec.high, spec.low + 8.0) - spec.low + 1.0))));
    case OptionKind::kNumber: {
      constexpr double kOrders = 1e3;
      const double usual = std::max(std::abs(parse_number(spec.default_value).value()), 1.0);
      return fmt::format(
          "{:.4g}", std::clamp(usual * log_uniform(random, 1.0 / kOrders, kOrders), spec.low, spec.high));
    }
    case OptionKind::kText:
      return spec.default_value;
  }
  return spec.default_value;
}

void turn_option(TrialInput& trial_input, Random& random, std::span<const OptionSpec> options) {
  if (options.empty()) return;
  const OptionSpec& spec = options[random.below(options.size())];
  Options given = trial_input.options;
  given.set(spec.key, random_value(spec, random));
  // Drops options that have no effect or are refused.
  if (validate(given, options, "hunt")) trial_input.options = std::move(given);
}

void turn_form(TrialInput& trial_input, Random& random) {
  std::vector<const FormRange*> own;
  for (const FormRange& form : kForms)
    if (form.shape == trial_input.shape) own.push_back(&form);
  if (own.empty()) return;
  const FormRange& form = *own[random.below(own.size())];
  trial_input.form.set(form.key, fmt::format("{:.4g}", log_uniform(random, form.low, form.high)));
}

void draw_shape(TrialInput& trial_input, Random& random) {
  trial_input.shape = one_of(kShapes, random);
  trial_input.form = {};
  for (std::uint64_t k = random.below(3); k > 0; --k) turn_form(trial_input, random);
}

void turn_model(TrialInput& trial_input, Random& random) {
  constexpr double kMostNoise = 0.6, kMostOutliers = 0.1, kSometimes = 0.3, kFarthest = 1e6;
  switch (random.below(9)) {
    case 0:
      draw_shape(trial_input, random);
      break;
    case 1:
      trial_input.points = static_cast<int>(log_uniform(random, kFewestPoints, kMostPoints));
      break;
    case 2:
      trial_input.sampling = one_of(kSamplings, random);
      break;
    case 3:
      trial_input.noise = chance(random, 0.5) ? 0.0 : random.uniform(0.0, kMostNoise);
      break;
    case 4:
      trial_input.outliers = chance(random, 0.5) ? 0.0 : random.uniform(0.0, kMostOutliers);
      break;
    case 5:
      trial_input.scale = chance(random, 0.5) ? 1.0 : log_uniform(random, kLeastScale, kMostScale);
      break;
    case 6:
      trial_input.offset = chance(random, 0.5) ? 0.0 : log_uniform(random, 1.0, kFarthest);
      break;
    case 7:
      turn_form(trial_input, random);
      break;
    default:
      trial_input.model_seed = 1 + random.below(1000);
      break;
  }
  trial_input.friction = chance(random, kSometimes) ? random.uniform() : 0.0;
}

void turn_way(TrialInput& trial_input, Random& random) {
  auto& way = trial_input.way;
  constexpr double kNudge = 0.3;
  const std::size_t at = way.empty() ? 0 : random.below(way.size());
  switch (random.below(5)) {
    case 0:
      if (way.size() < kMostWaypoints)
        way.insert(way.begin() + static_cast<std::ptrdiff_t>(at), random_waypoint(random));
      break;
    case 1:
      if (way.size() > 1) way.erase(way.begin() + static_cast<std::ptrdiff_t>(at));
      break;
    case 2:
      if (!way.empty()) way[at].at += any_vector(random, kNudge);
      break;
    case 3:
      if (!way.empty()) way[at].frames = static_cast<int>(log_uniform(random, 1.0, kSlowestLeg));
      break;
    default:
      if (!way.empty()) way[at] = random_waypoint(random);
      break;
  }
}

void turn_edits(TrialInput& trial_input, Random& random) {
  auto& edits = trial_input.edits;
  if (!edits.empty() && (chance(random, 0.5) || edits.size() >= kMostEdits))
    edits.erase(edits.begin() + static_cast<std::ptrdiff_t>(random.below(edits.size())));
  else
    edits.push_back(random_edit(random));
}

void turn_hand(HandWay& hand, Random& random) {
  // The default hand presses with at most 0.6 N and strokes at 60 mm/s. Harder hands go deeper than Caught
  // tolerates, where an edge a spacing off decides which side is felt.
  constexpr double kSoftestN = 0.1, kHardestN = 0.6, kSlowMmS = 10.0, kFastMmS = 120.0;
  // Two of the coarsest spacings are the millimetre that Caught tolerates for any points.
  constexpr double kDensestMm = 0.1, kCoarsestMm = metrics::kCaughtMm / metrics::kCaughtSpacings;
  constexpr std::uint64_t kSeeds = 1'000'000;
  switch (random.below(5)) {
    case 0:
      hand.force_n = random.uniform(kSoftestN, kHardestN);
      break;
    case 1:
      hand.fastest_mm_s = log_uniform(random, kSlowMmS, kFastMmS);
      break;
    case 2:
      hand.spacing_mm = log_uniform(random, kDensestMm, kCoarsestMm);
      break;
    default:
      hand.seed = random.below(kSeeds);
      break;
  }
}

/// Restricts the trial_input to what has a truth, at the hand's spacing.
void suit_hand(TrialInput& trial_input) {
  constexpr double kMostNoise = 0.3;
  trial_input.edits.clear();
  trial_input.outliers = trial_input.offset = trial_input.friction = 0.0;
  trial_input.noise = std::min(trial_input.noise, kMostNoise);
  trial_input.points = std::max(trial_input.points, static_cast<int>(kFewestJudged));
  trial_input.scale = 1.0;
  const Result<NamedOptions> named = parse_named_options(trial_input.model_text());
  const Result<cloud::GeneratedModel> made = named ? cloud::generate(*named) : Error{};
  if (made) trial_input.scale = trial_input.hand->spacing_mm / made->nominal_spacing_mm;
}

/// Restricts the trial_input to height fields: nothing sideways.
void flatten(TrialInput& trial_input) {
  constexpr std::size_t kHeightShapes = 5;  // the first ones
  if (std::find(kShapes.begin(), kShapes.begin() + kHeightShapes, trial_input.shape) ==
      kShapes.begin() + kHeightShapes) {
    trial_input.shape = kShapes[static_cast<std::size_t>(trial_input.points) % kHeightShapes];
    trial_input.form = {};
  }
  trial_input.sampling = "grid";
  trial_input.noise = trial_input.outliers = 0.0;
  for (PointEdit& change : trial_input.edits) {
    change.kind = PointEdit::Kind::kMove;
    change.by.x() = change.by.y() = 0.0;
  }
}

}  // namespace

bool TrialInput::keeps_raster() const {
  return std::all_of(edits.begin(), edits.end(), [](const PointEdit& change) {
    return change.kind == PointEdit::Kind::kMove && change.by.x() == 0.0 && change.by.y() == 0.0;
  });
}

bool TrialInput::open() const {
  return shape == "sinusoid" || shape == "plane" || shape == "saddle" || shape == "relief" ||
         shape == "wedge" || shape == "bowl";
}

double TrialInput::finest_mm() const {
  double finest = std::numeric_limits<double>::infinity();
  const cloud::Generator* generator = cloud::find_generator(shape);
  const Result<Options> complete = generator != nullptr ? cloud::complete_options(*generator, form) : Error{};
  if (!complete) return finest;
  for (const FormRange& range : kForms)
    if (range.shape == shape && range.finest_mm > 0.0)
      finest = std::min(finest, range.finest_mm * complete->number(range.key));
  return scale * finest;
}

std::string HandWay::path_text() const {
  constexpr double kSlowestShare = 0.25;
  return fmt::format("hand:frames={}:force_n={:.17g}:slowest_mm_s={:.17g}:fastest_mm_s={:.17g}:seed={}",
                     kHandFrames, force_n, kSlowestShare * fastest_mm_s, fastest_mm_s, seed);
}

std::string TrialInput::model_text() const {
  std::string text = fmt::format("{}:points={}:scale={:.17g}", shape, points, scale);
  for (const auto& [key, value] : form.all()) text += fmt::format(":{}={}", key, value);
  // A hand needs the faces to see where a surface ends.
  if (!hand) text += ":mesh=false";
  // A seed without effect is refused.
  if (shape == "relief" || shape == "pebble" || sampling != "grid" || noise > 0.0 || outliers > 0.0)
    text += fmt::format(":seed={}", model_seed);
  if (sampling != "grid") text += ":sampling=" + sampling;
  if (noise > 0.0) text += fmt::format(":noise={:.17g}", noise);
  if (outliers > 0.0) text += fmt::format(":outliers={:.17g}", outliers);
  return text;
}

TrialInput random_trial_input(Random& random, const Ground& ground) {
  constexpr int kModelTurns = 6, kHandTurns = 5;
  constexpr double kUsualForceN = 0.6, kUsualFastestMmS = 60.0, kUsualSpacingMm = 0.3;
  TrialInput trial_input;
  draw_shape(trial_input, random);
  trial_input.points = static_cast<int>(log_uniform(random, kFewestPoints, kMostPoints));
  trial_input.sampling = one_of(kSamplings, random);
  for (int k = 0; k < kModelTurns; ++k) turn_model(trial_input, random);
  constexpr double kWithOptions = 0.4, kWithEdits = 0.4, kWithHand = 0.5;
  if (chance(random, kWithOptions)) turn_option(trial_input, random, ground.options);
  if (chance(random, kWithEdits))
    for (std::uint64_t k = 1 + random.below(kMostEdits / 2); k > 0; --k)
      trial_input.edits.push_back(random_edit(random));
  if (chance(random, kWithHand)) {
    trial_input.hand = HandWay{kUsualForceN, kUsualFastestMmS, kUsualSpacingMm, 1};
    for (int k = 0; k < kHandTurns; ++k) turn_hand(*trial_input.hand, random);
  } else {
    for (std::uint64_t k = 2 + random.below(kMostWaypoints / 2); k > 0; --k)
      trial_input.way.push_back(random_waypoint(random));
  }
  if (ground.heights) flatten(trial_input);
  if (trial_input.hand) suit_hand(trial_input);
  return trial_input;
}

TrialInput mutated(const TrialInput& trial_input, Random& random, const Ground& ground) {
  constexpr double kWay = 0.6, kEdits = 0.2, kModel = 0.13;  // the rest varies an option
  TrialInput next = trial_input;
  for (std::uint64_t k = 1 + random.below(3); k > 0; --k) {
    const double what = random.uniform();
    if (what < kWay && next.hand)
      turn_hand(*next.hand, random);
    else if (what < kWay)
      turn_way(next, random);
    else if (what < kWay + kEdits && !next.hand)
      turn_edits(next, random);
    else if (what < kWay + kEdits + kModel)
      turn_model(next, random);
    else
      turn_option(next, random, ground.options);
  }
  if (ground.heights) flatten(next);
  if (next.hand) suit_hand(next);
  return next;
}

}  // namespace palpate::experiments
