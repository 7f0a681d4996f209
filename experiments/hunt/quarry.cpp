#include "experiments/hunt/quarry.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

namespace palpate::experiments {
namespace {

constexpr std::array kShapes = {"sinusoid", "plane", "saddle",    "relief",      "wedge", "sphere", "pebble",
                                "torus",    "slab",  "ellipsoid", "rounded-box", "bowl",  "shells"};
constexpr std::array kSamplings = {"grid", "random", "blue", "grid"};
// Few points: what breaks with thousands breaks with hundreds, and a trial is over in milliseconds.
constexpr double kFewestPoints = 16.0, kMostPoints = 4000.0;
constexpr double kLeastScale = 1e-3, kMostScale = 1e6;
constexpr int kMostEdits = 12, kMostWaypoints = 14, kSlowestLeg = 200;

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
/// A direction and a length of any order up to `most`.
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
  // Often near: the next point of the store is near in space.
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

/// A value that the specification allows; numbers around the default, over some orders.
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

void turn_option(Quarry& quarry, Random& random, std::span<const OptionSpec> options) {
  if (options.empty()) return;
  const OptionSpec& spec = options[random.below(options.size())];
  Options given = quarry.options;
  given.set(spec.key, random_value(spec, random));
  // What would do nothing or is refused is not worth a trial.
  if (validate(given, options, "hunt")) quarry.options = std::move(given);
}

void turn_model(Quarry& quarry, Random& random) {
  constexpr double kMostNoise = 0.6, kMostOutliers = 0.1, kSometimes = 0.3, kFarthest = 1e6;
  switch (random.below(8)) {
    case 0:
      quarry.shape = one_of(kShapes, random);
      break;
    case 1:
      quarry.points = static_cast<int>(log_uniform(random, kFewestPoints, kMostPoints));
      break;
    case 2:
      quarry.sampling = one_of(kSamplings, random);
      break;
    case 3:
      quarry.noise = chance(random, 0.5) ? 0.0 : random.uniform(0.0, kMostNoise);
      break;
    case 4:
      quarry.outliers = chance(random, 0.5) ? 0.0 : random.uniform(0.0, kMostOutliers);
      break;
    case 5:
      quarry.scale = chance(random, 0.5) ? 1.0 : log_uniform(random, kLeastScale, kMostScale);
      break;
    case 6:
      quarry.offset = chance(random, 0.5) ? 0.0 : log_uniform(random, 1.0, kFarthest);
      break;
    default:
      quarry.model_seed = 1 + random.below(1000);
      break;
  }
  quarry.friction = chance(random, kSometimes) ? random.uniform() : 0.0;
}

void turn_way(Quarry& quarry, Random& random) {
  auto& way = quarry.way;
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

void turn_edits(Quarry& quarry, Random& random) {
  auto& edits = quarry.edits;
  if (!edits.empty() && (chance(random, 0.5) || edits.size() >= kMostEdits))
    edits.erase(edits.begin() + static_cast<std::ptrdiff_t>(random.below(edits.size())));
  else
    edits.push_back(random_edit(random));
}

nlohmann::json json_of(const Vec3& v) {
  return {v.x(), v.y(), v.z()};
}
Vec3 vector_of(const nlohmann::json& json) {
  return {json.at(0).get<double>(), json.at(1).get<double>(), json.at(2).get<double>()};
}

}  // namespace

std::string Quarry::model_text() const {
  std::string text =
      fmt::format("{}:points={}:scale={:.17g}:mesh=false:seed={}", shape, points, scale, model_seed);
  if (sampling != "grid") text += ":sampling=" + sampling;
  if (noise > 0.0) text += fmt::format(":noise={:.17g}", noise);
  if (outliers > 0.0) text += fmt::format(":outliers={:.17g}", outliers);
  return text;
}

Quarry random_quarry(Random& random, std::span<const OptionSpec> options) {
  constexpr int kModelTurns = 6;
  Quarry quarry;
  quarry.shape = one_of(kShapes, random);
  quarry.points = static_cast<int>(log_uniform(random, kFewestPoints, kMostPoints));
  quarry.sampling = one_of(kSamplings, random);
  for (int k = 0; k < kModelTurns; ++k) turn_model(quarry, random);
  constexpr double kWithOptions = 0.4, kWithEdits = 0.4;
  if (chance(random, kWithOptions)) turn_option(quarry, random, options);
  if (chance(random, kWithEdits))
    for (std::uint64_t k = 1 + random.below(kMostEdits / 2); k > 0; --k)
      quarry.edits.push_back(random_edit(random));
  for (std::uint64_t k = 2 + random.below(kMostWaypoints / 2); k > 0; --k)
    quarry.way.push_back(random_waypoint(random));
  return quarry;
}

Quarry mutated(const Quarry& quarry, Random& random, std::span<const OptionSpec> options) {
  constexpr double kWay = 0.6, kEdits = 0.2, kModel = 0.13;  // the rest turns an option
  Quarry next = quarry;
  for (std::uint64_t k = 1 + random.below(3); k > 0; --k) {
    const double what = random.uniform();
    if (what < kWay)
      turn_way(next, random);
    else if (what < kWay + kEdits)
      turn_edits(next, random);
    else if (what < kWay + kEdits + kModel)
      turn_model(next, random);
    else
      turn_option(next, random, options);
  }
  return next;
}

std::string to_text(const Quarry& quarry) {
  nlohmann::json edits = nlohmann::json::array(), way = nlohmann::json::array();
  for (const PointEdit& e : quarry.edits)
    edits.push_back({{"kind", e.kind}, {"which", e.which}, {"other", e.other}, {"by", json_of(e.by)}});
  for (const Waypoint& w : quarry.way)
    way.push_back({{"kind", w.kind},
                   {"at", json_of(w.at)},
                   {"which", w.which},
                   {"other", w.other},
                   {"frames", w.frames}});
  nlohmann::json options = nlohmann::json::object();
  for (const auto& [key, value] : quarry.options.all()) options[key] = value;
  return nlohmann::json{{"shape", quarry.shape},
                        {"points", quarry.points},
                        {"sampling", quarry.sampling},
                        {"noise", quarry.noise},
                        {"outliers", quarry.outliers},
                        {"seed", quarry.model_seed},
                        {"scale", quarry.scale},
                        {"offset", quarry.offset},
                        {"friction", quarry.friction},
                        {"edits", edits},
                        {"way", way},
                        {"options", options}}
      .dump();
}

bool from_text(const std::string& text, Quarry& quarry) {
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    quarry = {};
    json.at("shape").get_to(quarry.shape);
    json.at("points").get_to(quarry.points);
    json.at("sampling").get_to(quarry.sampling);
    json.at("noise").get_to(quarry.noise);
    json.at("outliers").get_to(quarry.outliers);
    json.at("seed").get_to(quarry.model_seed);
    json.at("scale").get_to(quarry.scale);
    json.at("offset").get_to(quarry.offset);
    json.at("friction").get_to(quarry.friction);
    for (const auto& e : json.at("edits"))
      quarry.edits.push_back({e.at("kind").get<PointEdit::Kind>(), e.at("which").get<double>(),
                              e.at("other").get<double>(), vector_of(e.at("by"))});
    for (const auto& w : json.at("way"))
      quarry.way.push_back({w.at("kind").get<Waypoint::Kind>(), vector_of(w.at("at")),
                            w.at("which").get<double>(), w.at("other").get<double>(),
                            w.at("frames").get<int>()});
    for (const auto& [key, value] : json.at("options").items())
      quarry.options.set(key, value.get<std::string>());
    return true;
  } catch (const nlohmann::json::exception&) {
    return false;
  }
}

}  // namespace palpate::experiments
