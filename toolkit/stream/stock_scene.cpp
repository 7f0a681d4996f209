#include "toolkit/stream/stock_scene.h"

#include <fmt/format.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <numbers>
#include <utility>

#include <palpate/generate.h>
#include <palpate/motion.h>
#include "toolkit/core/messages.h"

namespace palpate::stream {
namespace {

/// Poses of a swinging model are published so often; between two, its speed carries it on. At 1 Hz and 50 mm
/// that is off by a thousandth of a millimetre.
constexpr double kSwingHz = 1000.0;
/// The distance at which noise is quoted.
constexpr double kNoiseAtMm = 1000.0;
constexpr double kMsPerS = 1000.0;
/// The first Kinect's: the field of view of 525 px at 640.
constexpr double kFocalPerWidth = 525.0 / 640.0;
/// Points of a model's cloud; formulas are what is seen and felt.
constexpr const char* kStockPoints = ":points=10000";
constexpr double kTableMm = 4000.0;

struct StockModel {
  const char* name;
  std::string generator;
  geometry::RigidTransform pose;
};

geometry::RigidTransform moved(double x, double y, double z, double about_z_deg = 0.0) {
  const double angle = about_z_deg * std::numbers::pi / 180.0;
  return {Eigen::Quaterniond(Eigen::AngleAxisd(angle, Vec3::UnitZ())), Vec3(x, y, z)};
}

StockModel table() {
  return {"table", fmt::format("plane:extent_mm={}", kTableMm), {}};
}

struct StockSpec {
  const char* name;
  std::vector<StockModel> models;
  geometry::RigidTransform world_from_camera;
  Vec3 swing_mm = Vec3::Zero();  ///< of the last model, and 0: at rest
  double swing_hz = 0.0;
};

std::vector<StockSpec> stock_specs() {
  const geometry::RigidTransform above = look_at({0.0, 0.0, 1000.0}, Vec3::Zero(), Vec3::UnitY()),
                                 aside = look_at({0.0, -700.0, 700.0}, Vec3::Zero(), Vec3::UnitZ());
  return {
      {"wall", {table()}, above},
      {"moving-wall", {table()}, above, {0.0, 0.0, 50.0}, 1.0},
      {"table",
       {table(),
        // Sunk halfway: a god object of the table would pass below what only stands on it.
        {"sphere", "sphere:extent_mm=120", moved(-120.0, 0.0, 0.0)},
        {"box", "slab:extent_mm=160:thickness_mm=160", moved(130.0, 0.0, 20.0, 30.0)}},
       aside},
      {"hand",
       {table(), {"hand", "sphere:extent_mm=80", moved(0.0, 0.0, 90.0)}},
       aside,
       {150.0, 0.0, 0.0},
       0.5},
      {"step",
       {table(),
        {"step", fmt::format("slab:extent_mm={}:thickness_mm=80", kTableMm),
         moved(-0.5 * kTableMm, 0.0, 0.0)}},
       above},
  };
}

/// An option of a real sensor, off where the sensor is ideal.
OptionSpec sensor_option(const char* key, const char* value, const char* help, double high) {
  return {key, OptionKind::kNumber, value, help, {}, 0.0, high, {{"sensor", {"real"}}}};
}
OptionSpec share_option(const char* key, const char* help) {
  return {key, OptionKind::kNumber, "0", help, {}, 0.0, 1.0};
}

std::vector<OptionSpec> camera_options() {
  return {
      {"width", OptionKind::kInteger, "640", "pixels across", {}, 8, 4096},
      {"height", OptionKind::kInteger, "480", "pixels down", {}, 8, 4096},
      {"rate_hz", OptionKind::kNumber, "30", "frames a second", {}, 1e-3, 1e4},
      {"frames", OptionKind::kInteger, "0", "frames in all; 0: without end", {}, 0, 1e9},
      {"start_s", OptionKind::kNumber, "0", "capture of the first frame", {}, 0, 1e6},
      {"seed", OptionKind::kInteger, "1", "of all errors", {}, 0, 1e15},
      {"sensor", OptionKind::kChoice, "real", "ideal: without errors", {"real", "ideal"}},
      // Kinect: 1.4 mm (Khoshelham and Elberink 2012), 75 mm, eighths of a pixel; lateral, grazing angle:
      // Nguyen, Izadi and Lovell 2012.
      sensor_option("noise_mm", "2", "standard deviation of a depth at 1 m; grows with its square", 1e3),
      sensor_option("lateral_px", "0.5", "standard deviation of where a pixel looks", 10.0),
      sensor_option("baseline_mm", "75", "camera to projector: shadows beside edges", 1e4),
      sensor_option("disparity_step_px", "0.125", "disparities are whole steps of it", 10.0),
      sensor_option("flying", "0.3", "share of the pixels at edges that hang in the air", 1.0),
      sensor_option("grazing_deg", "80", "steeper surfaces are holes; 0: none", 90.0),
      sensor_option("dropout", "0.005", "share of pixels without a depth", 1.0),
      {"latency_ms", OptionKind::kNumber, "20", "capture to arrival", {}, 0.0, 1e5},
      {"jitter_ms", OptionKind::kNumber, "1", "standard deviation of the latency", {}, 0.0, 1e5},
      share_option("late", "share of frames held up by three periods"),
      share_option("repeated", "share of frames that come twice"),
      share_option("unordered", "share of frames that come after the next one"),
      share_option("truncated", "share of frames that lose the end of their depths"),
  };
}

std::vector<OptionSpec> options_of(const StockSpec& scene) {
  std::vector<OptionSpec> specs = camera_options();
  if (scene.swing_hz > 0.0) {
    specs.push_back({"amplitude_mm",
                     OptionKind::kNumber,
                     fmt::format("{}", scene.swing_mm.norm()),
                     "of the moving model, from its middle",
                     {},
                     0.0,
                     1e3});
    specs.push_back(
        {"hz", OptionKind::kNumber, fmt::format("{}", scene.swing_hz), "swings a second", {}, 0.0, 100.0});
  }
  return specs;
}

const StockSpec* find_spec(const std::vector<StockSpec>& specs, const std::string& name) {
  const auto found = std::ranges::find(specs, name, &StockSpec::name);
  return found != specs.end() ? &*found : nullptr;
}

void set_camera(const Options& options, StockScene& out) {
  DepthCamera& camera = out.camera;
  camera.width = static_cast<int>(options.integer("width"));
  camera.height = static_cast<int>(options.integer("height"));
  camera.fx_px = camera.fy_px = kFocalPerWidth * camera.width;
  camera.cx_px = 0.5 * (camera.width - 1);
  camera.cy_px = 0.5 * (camera.height - 1);
  camera.period_s = 1.0 / options.number("rate_hz");
  SimulatedSensor& simulated = out.simulated;
  simulated.start_s = options.number("start_s");
  simulated.frames = static_cast<std::uint64_t>(options.integer("frames"));
  simulated.seed = static_cast<std::uint64_t>(options.integer("seed"));
  simulated.transport = {options.number("latency_ms") / kMsPerS,
                         options.number("jitter_ms") / kMsPerS,
                         options.number("late"),
                         options.number("repeated"),
                         options.number("unordered"),
                         options.number("truncated")};
  if (options.text("sensor") == "ideal") return;
  camera.noise_per_mm = options.number("noise_mm") / (kNoiseAtMm * kNoiseAtMm);
  simulated.sensor = {options.number("lateral_px"),        options.number("baseline_mm"),
                      options.number("disparity_step_px"), options.number("flying"),
                      options.number("grazing_deg"),       options.number("dropout")};
}

Status add_models(const StockSpec& spec, const Options& options, render::SceneInput& scene) {
  for (const StockModel& stock : spec.models) {
    PALPATE_ASSIGN(const NamedOptions generator, parse_named_options(stock.generator + kStockPoints));
    PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(generator));
    render::ModelInput model;
    model.name = stock.name;
    model.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
    model.analytic = std::move(made.surface);
    model.world_from_model = stock.pose;
    scene.models.push_back(std::move(model));
  }
  if (spec.swing_hz > 0.0) {
    render::ModelInput& model = scene.models.back();
    render::ScriptedMotion swing{model.world_from_model};
    swing.swing_mm = options.number("amplitude_mm") * spec.swing_mm.normalized();
    swing.swing_hz = options.number("hz");
    auto simulation = std::make_shared<render::ScriptedSimulation>(kSwingHz);
    model.motion = simulation->add(swing);
    scene.simulation = std::move(simulation);
  }
  return Done{};
}

}  // namespace

geometry::RigidTransform look_at(const Vec3& eye_mm, const Vec3& target_mm, const Vec3& up) {
  const Vec3 forward = (target_mm - eye_mm).normalized();
  const Vec3 right = forward.cross(up).normalized();
  Mat3 world_from_camera;
  world_from_camera << right, forward.cross(right), forward;
  return {Eigen::Quaterniond(world_from_camera).normalized(), eye_mm};
}

std::vector<std::string> stock_scene_names() {
  return names_of(stock_specs());
}

Result<StockScene> stock_scene(const std::string& text) {
  const std::string_view prefix = kSimulatedPrefix;
  PALPATE_ASSIGN(
      const NamedOptions given,
      parse_named_options(std::string_view(text).substr(text.starts_with(prefix) ? prefix.size() : 0)));
  const std::vector<StockSpec> specs = stock_specs();
  const StockSpec* const spec = find_spec(specs, given.name);
  if (spec == nullptr)
    return Error{"there is no stock scene " + shown(given.name),
                 did_you_mean(given.name, stock_scene_names(), "scenes: " + joined(stock_scene_names()))};
  PALPATE_ASSIGN(const Options options,
                 validate(given.options, options_of(*spec), kSimulatedPrefix + given.name));
  StockScene out;
  out.world_from_camera = spec->world_from_camera;
  set_camera(options, out);
  PALPATE_TRY(add_models(*spec, options, out.scene));
  return out;
}

Result<StockScene> camera_before(render::SceneInput scene, const std::string& spec) {
  const std::string name = "scene";
  PALPATE_ASSIGN(const NamedOptions given, parse_named_options(name + spec));
  PALPATE_ASSIGN(const Options options, validate(given.options, camera_options(), kSimulatedPrefix + name));
  StockScene out;
  set_camera(options, out);
  geometry::Aabb box;
  for (const render::ModelInput& model : scene.models) {
    const geometry::Aabb own = model.cloud->box_mm();
    for (const double x : {own.low_mm.x(), own.high_mm.x()})
      for (const double y : {own.low_mm.y(), own.high_mm.y()})
        for (const double z : {own.low_mm.z(), own.high_mm.z()})
          box.add(model.world_from_model * Vec3(x, y, z));
  }
  // The tangent to a sphere at half the image's smaller side.
  const double half_px = 0.5 * std::min(out.camera.width, out.camera.height);
  const double away_mm = 0.5 * box.extent_mm().norm() * std::hypot(1.0, out.camera.fx_px / half_px);
  const Vec3 middle = box.centre_mm();
  out.world_from_camera =
      look_at(middle + away_mm * Vec3(0.0, -1.0, 1.0).normalized(), middle, Vec3::UnitZ());
  out.scene = std::move(scene);
  return out;
}

}  // namespace palpate::stream
