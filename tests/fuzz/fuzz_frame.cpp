// Fuzzes frames: bytes give a small model, a renderer of ours with options, and HIP motion. Frames keep their
// guarantees, and a restart repeats them. tests/house replays the findings in tests/corpus/frame.
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include <palpate/registry.h>
#include "tests/fuzz/must.h"
#include "toolkit/core/hash.h"
#include "toolkit/render/frame_loop.h"

namespace {

using namespace palpate;

constexpr double kLimitN = 3.3, kPeriodS = 1e-3;
/// Rounding when a force is scaled to its limit.
constexpr double kLimitRounding = 1.0 + 1e-12;
/// Coordinates are 16 bits over +-32 mm.
constexpr double kStepMm = 1.0 / 1024.0;
constexpr std::size_t kMostPoints = 96, kMostFrames = 400;

/// Reads byte by byte; zeros at the end.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data, size) {}
  [[nodiscard]] bool empty() const { return at_ >= data_.size(); }
  std::uint8_t byte() { return empty() ? std::uint8_t{0} : data_[at_++]; }
  double coordinate() {
    const auto low = static_cast<unsigned>(byte()), high = static_cast<unsigned>(byte());
    return kStepMm * (static_cast<double>(high << 8 | low) - 32768.0);
  }
  Vec3 place() {
    const double x = coordinate(), y = coordinate(), z = coordinate();
    return {x, y, z};
  }

 private:
  std::span<const std::uint8_t> data_;
  std::size_t at_ = 0;
};

struct Chosen {
  const char* name;
  const char* key;
  const char* value;
};
constexpr std::array<Chosen, 14> kChosen = {{
    {"cloud", nullptr, nullptr},
    {"cloud-smooth", nullptr, nullptr},
    {"heightfield", nullptr, nullptr},
    {"cloud", "refine", "1"},
    {"cloud", "refine", "2"},
    {"cloud", "sides", "both"},
    {"cloud", "raster", "off"},
    {"cloud", "walk_steps", "16"},
    {"cloud", "combine", "sum"},
    {"brute-force", nullptr, nullptr},
    {"cloud-smooth", "detail", "0.5"},
    {"cloud-smooth", "voxel", "4"},
    {"heightfield", "shading", "nearest"},
    {"heightfield", "holes", "open"},
}};

/// Points anywhere, or heights over a raster.
cloud::Cloud model_of(Bytes& bytes, bool heights) {
  std::vector<Vec3> points;
  cloud::ScanRaster raster;
  if (heights) {
    constexpr unsigned kMostPosts = 9;
    raster.columns = 2 + bytes.byte() % kMostPosts;
    raster.rows = 2 + bytes.byte() % kMostPosts;
    for (std::uint32_t row = 0; row < raster.rows; ++row)
      for (std::uint32_t column = 0; column < raster.columns; ++column)
        points.emplace_back(column, row, bytes.coordinate());
  } else {
    const std::size_t count = 1 + bytes.byte() % kMostPoints;
    while (points.size() < count) points.push_back(bytes.place());
  }
  cloud::Cloud cloud = cloud::build_cloud(points, cloud::NonFinite::kRefuse).value();
  if (heights) cloud.raster = raster;
  return cloud;
}

enum class Move : std::uint8_t { kTo, kAtPoint, kBy, kBetween, kOdd, kReleaseContact, kRestart, kCount };

struct Act {
  Move move = Move::kTo;
  Vec3 hip = Vec3::Zero();
};

std::vector<Act> acts_of(Bytes& bytes, const cloud::Cloud& cloud) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
  constexpr std::array kOdd = {kNothing, kInfinite, -kInfinite, 1e300, -1e300, 5e-324, 1e18, 0.0};
  std::vector<Act> acts;
  Vec3 at = cloud.box_mm().high_mm + Vec3::Ones();
  while (!bytes.empty() && acts.size() < kMostFrames) {
    const auto move = static_cast<Move>(bytes.byte() % static_cast<unsigned>(Move::kCount));
    Act act{move, at};
    switch (move) {
      case Move::kTo:
        act.hip = bytes.place();
        break;
      case Move::kAtPoint:
        act.hip = cloud.point_mm(bytes.byte() % cloud.size());
        break;
      case Move::kBy:
        for (int axis = 0; axis < 3; ++axis) act.hip[axis] += 64.0 * kStepMm * (bytes.byte() - 128.0);
        break;
      case Move::kBetween: {
        const std::size_t i = bytes.byte() % cloud.size(), j = bytes.byte() % cloud.size();
        act.hip = 0.5 * (cloud.point_mm(i) + cloud.point_mm(j));
        break;
      }
      case Move::kOdd:
        act.hip[bytes.byte() % 3] = kOdd[bytes.byte() % kOdd.size()];
        break;
      default:
        break;
    }
    if (is_finite(act.hip)) at = act.hip;
    acts.push_back(act);
  }
  return acts;
}

std::uint64_t played(render::HapticRenderer& renderer, const std::vector<Act>& acts, const Vec3& start) {
  Hash64 hash;
  double t_s = 0.0;
  renderer.restart(start, t_s);
  for (const Act& act : acts) {
    t_s += kPeriodS;
    if (act.move == Move::kReleaseContact) renderer.release_contact(act.hip);
    if (act.move == Move::kRestart) renderer.restart(act.hip, t_s - kPeriodS);
    const render::Frame frame = renderer.step(act.hip, t_s);
    must(is_finite(frame.force_n));
    must(frame.force_n.norm() <= kLimitN * kLimitRounding);
    must((frame.status == render::FrameStatus::kNonFinite) == !render::is_representable_hip(act.hip));
    must(frame.contact || frame.force_n == Vec3::Zero());
    must(frame.contact == (frame.model == 0));
    if (render::is_representable_hip(act.hip)) must(is_finite(frame.god_object_mm));
    hash.byte(static_cast<std::uint8_t>(frame.contact));
    for (int axis = 0; axis < 3; ++axis) hash.real(frame.force_n[axis]);
    for (int axis = 0; axis < 3; ++axis) hash.real(frame.god_object_mm[axis]);
  }
  return hash.value();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const render::Registry registry = [] {
    render::Registry all;
    render::register_toolkit_renderers(all);
    return all;
  }();
  Bytes bytes(data, size);
  const Chosen& chosen = kChosen[bytes.byte() % kChosen.size()];
  const std::uint8_t surface = bytes.byte();
  Options options;
  if (chosen.key != nullptr) options.set(chosen.key, chosen.value);
  auto renderer = registry.make(chosen.name, options);
  must(renderer.ok());
  render::ModelInput model;
  model.cloud =
      std::make_shared<const cloud::Cloud>(model_of(bytes, std::string_view(chosen.name) == "heightfield"));
  constexpr double kFriction = 0.7;
  if ((surface & 1u) != 0) model.surface.friction = {kFriction, kFriction};
  if ((surface & 2u) != 0) model.surface.deformation = 0.5;
  render::SceneInput scene;
  scene.models.push_back(model);
  scene.force_limit_n = kLimitN;
  if (!(*renderer)->prepare(scene, {1, nullptr})) return 0;
  const std::vector<Act> acts = acts_of(bytes, *model.cloud);
  const Vec3 start = model.cloud->box_mm().high_mm + Vec3::Ones();
  const std::uint64_t once = played(**renderer, acts, start);
  must(played(**renderer, acts, start) == once);
  return 0;
}
