#include "toolkit/stream/simulated_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/random.h"
#include "toolkit/render/depth_camera.h"

namespace palpate::stream {

// ---- the scene

Result<std::unique_ptr<SimulatedScene>> SimulatedScene::make(render::SceneInput input) {
  std::unique_ptr<SimulatedScene> scene(new SimulatedScene(std::move(input)));
  for (const render::ModelInput& input_model : scene->scene_.models) {
    Model model;
    if (input_model.analytic != nullptr) {
      model.box_mm = input_model.analytic->box_mm();
    } else if (input_model.original_mesh != nullptr && !input_model.original_mesh->empty()) {
      for (const Vec3& vertex : input_model.original_mesh->vertices_mm) model.box_mm.add(vertex);
      model.faces = std::make_unique<geometry::MeshRayCaster>(*input_model.original_mesh);
    } else {
      return Error{"a simulated camera cannot see the model " + shown(input_model.name),
                   "use generated models, or files with faces"};
    }
    scene->models_.push_back(std::move(model));
  }
  if (scene->scene_.simulation != nullptr) scene->scene_.simulation->reset();
  scene->go_to(0.0);
  return scene;
}

void SimulatedScene::go_to(double t_s) noexcept {
  if (scene_.simulation != nullptr) {
    if (t_s < now_s_) scene_.simulation->reset();
    scene_.simulation->advance(t_s);
  }
  now_s_ = t_s;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const render::ModelInput& input = scene_.models[i];
    models_[i].world_from_model =
        input.motion != nullptr ? input.motion->newest().at(t_s) : input.world_from_model;
    models_[i].model_from_world = models_[i].world_from_model.inverse();
  }
}

std::optional<SceneHit> SimulatedScene::first_hit(const Vec3& origin_mm,
                                                  const Vec3& direction) const noexcept {
  const double length = direction.norm();
  std::optional<SceneHit> first;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const Model& model = models_[i];
    const Vec3 from = model.model_from_world * origin_mm;
    // To the far side of the sphere about the box: a hit before it ends the ray there.
    const double reach =
        ((from - model.box_mm.centre_mm()).norm() + 0.5 * model.box_mm.extent_mm().norm()) / length;
    const double end = first ? std::min(first->along, reach) : reach;
    const Vec3 to = from + end * model.model_from_world.rotate(direction);
    const std::optional<geometry::SurfacePoint> hit = model.faces != nullptr
                                                          ? model.faces->first_hit(from, to)
                                                          : scene_.models[i].analytic->first_entry(from, to);
    if (!hit) continue;
    const double along = (hit->point_mm - from).norm() / length;
    if (!first || along < first->along) first = {along, model.world_from_model.rotate(hit->normal)};
  }
  return first;
}

// ---- the camera

namespace {

/// Rows of a piece of work: some 5000 rays, a millisecond.
constexpr std::size_t kRowsPerChunk = 8;
/// A neighbour so many pixels' widths nearer or farther is beyond an edge: a plane at 80 degrees, the
/// steepest that returns light, rises by its tangent, 5.7.
constexpr double kEdgeWidths = 6.0;
/// A lit point is met by the projector's ray up to rounding, which is some 1e-13 of its length.
constexpr double kLitSlack = 1e-9;
/// Periods that a late frame takes longer.
constexpr double kLatePeriods = 3.0;

/// Uses of a seed, so that one error's numbers do not change with another's.
enum class Draw : std::uint64_t { kLook, kDepth, kTransport, kFault };

Random random_of(std::uint64_t seed, Draw draw, std::uint64_t frame, std::uint64_t row) {
  constexpr std::uint64_t kDraws = 4, kRows = std::uint64_t{1} << 20;
  return Random(seed ^ mixed64((frame * kRows + row) * kDraws + static_cast<std::uint64_t>(draw)));
}

class SimulatedCamera final : public DepthSource {
 public:
  SimulatedCamera(std::unique_ptr<SimulatedScene> scene, const DepthCamera& camera, CameraPath path,
                  const SimulatedSensor& simulated, std::string name, int threads)
      : scene_(std::move(scene)),
        camera_(camera),
        path_(std::move(path)),
        simulated_(simulated),
        name_(std::move(name)),
        threads_(threads),
        columns_(static_cast<std::size_t>(camera.width)),
        rays_(camera.pixels()),
        seen_mm_(camera.pixels()) {
    for (std::size_t i = 0; i < rays_.size(); ++i)
      rays_[i] =
          render::ray_of(camera_, static_cast<double>(i % columns_), static_cast<double>(i / columns_));
  }

  [[nodiscard]] const DepthCamera& camera() const noexcept override { return camera_; }
  [[nodiscard]] std::uint64_t frames() const noexcept override { return simulated_.frames; }
  [[nodiscard]] std::string describe() const override {
    const SensorErrors& e = simulated_.sensor;
    return fmt::format(
        "{} (simulated): {} x {} at {:g} Hz, noise {:g} mm at 1 m, lateral {:g} px, baseline {:g} mm", name_,
        camera_.width, camera_.height, 1.0 / camera_.period_s, camera_.noise_at_mm(1000.0), e.lateral_px,
        e.baseline_mm);
  }
  [[nodiscard]] Status restart() override {
    next_number_ = delivered_ = 0;
    arrived_s_ = -HUGE_VAL;
    waiting_.clear();
    return Done{};
  }

  [[nodiscard]] Result<bool> next(DepthFrame& frame) override {
    if (waiting_.empty()) line_up();
    if (waiting_.empty()) return false;
    const std::uint64_t number = waiting_.back();
    waiting_.pop_back();
    capture(number, frame);
    const TransportErrors& t = simulated_.transport;
    Random random = random_of(simulated_.seed, Draw::kTransport, delivered_++, 0);
    double latency_s = t.latency_s + t.jitter_s * random.normal();
    if (random.uniform() < t.late) latency_s += kLatePeriods * camera_.period_s;
    // Frames come down one line: none overtakes the one before it.
    arrived_s_ = std::max(arrived_s_, frame.captured_s + std::max(0.0, latency_s));
    frame.arrived_s = arrived_s_;
    if (random.uniform() < t.truncated) frame.depth_mm.resize(random.below(frame.depth_mm.size()));
    return true;
  }

 private:
  /// Puts the next frame, or the next two, in the order in which they come, the last first.
  void line_up() {
    const TransportErrors& t = simulated_.transport;
    const auto left = [this] { return simulated_.frames == 0 || next_number_ < simulated_.frames; };
    if (!left()) return;
    Random random = random_of(simulated_.seed, Draw::kFault, next_number_, 0);
    waiting_.push_back(next_number_++);
    if (random.uniform() < t.repeated) waiting_.push_back(waiting_.back());
    if (random.uniform() < t.unordered && left()) waiting_.push_back(next_number_++);
  }

  void capture(std::uint64_t number, DepthFrame& frame) {
    frame.number = number;
    frame.captured_s = simulated_.start_s + static_cast<double>(number) * camera_.period_s;
    frame.world_from_camera = path_(frame.captured_s);
    frame.depth_mm.resize(rays_.size());
    scene_->go_to(frame.captured_s);
    const auto rows = static_cast<std::size_t>(camera_.height);
    parallel_each(rows, kRowsPerChunk, threads_,
                  [&](std::size_t row) { cast_row(number, row, frame.world_from_camera); });
    parallel_each(rows, kRowsPerChunk, threads_,
                  [&](std::size_t row) { measure(number, row, frame.depth_mm.data()); });
  }

  /// Depths that the row's pixels look at; 0 where no light returns.
  void cast_row(std::uint64_t number, std::size_t row, const geometry::RigidTransform& world_from_camera) {
    const SensorErrors& e = simulated_.sensor;
    const double least_cosine =
        e.grazing_deg > 0.0 ? std::cos(e.grazing_deg * std::numbers::pi / 180.0) : 0.0;
    const Vec3 eye = world_from_camera.translation_mm;
    const Vec3 projector = world_from_camera * Vec3(e.baseline_mm, 0.0, 0.0);
    Random random = random_of(simulated_.seed, Draw::kLook, number, row);
    for (std::size_t i = row * columns_; i < (row + 1) * columns_; ++i) {
      Vec3 ray = rays_[i];
      if (e.lateral_px > 0.0) {
        ray.x() += e.lateral_px / camera_.fx_px * random.normal();
        ray.y() += e.lateral_px / camera_.fy_px * random.normal();
      }
      const Vec3 direction = world_from_camera.rotate(ray);
      const std::optional<SceneHit> hit = scene_->first_hit(eye, direction);
      seen_mm_[i] = hit && std::abs(hit->normal.dot(direction)) >= least_cosine * direction.norm() &&
                            is_lit(projector, eye + hit->along * direction)
                        ? hit->along
                        : 0.0;
    }
  }
  [[nodiscard]] bool is_lit(const Vec3& projector, const Vec3& point) const noexcept {
    if (!(simulated_.sensor.baseline_mm > 0.0)) return true;
    const std::optional<SceneHit> hit = scene_->first_hit(projector, point - projector);
    return !hit || hit->along >= 1.0 - kLitSlack;
  }

  /// Errors of the row's depths.
  void measure(std::uint64_t number, std::size_t row, float* depth_mm) const {
    const SensorErrors& e = simulated_.sensor;
    const double disparity_mm_px = camera_.fx_px * e.baseline_mm;
    Random random = random_of(simulated_.seed, Draw::kDepth, number, row);
    for (std::size_t i = row * columns_; i < (row + 1) * columns_; ++i) {
      double z = seen_mm_[i];
      // Every pixel draws the same numbers, so that one switched off leaves the others.
      const double noise = random.normal(), at_random = random.uniform(), between = random.uniform(),
                   flies = random.uniform();
      if (z > 0.0 && flies < e.flying) {
        const double other = beyond_edge(i);
        if (other > 0.0) z += between * (other - z);
      }
      if (z > 0.0) z += camera_.noise_at_mm(z) * noise;
      if (z > 0.0 && disparity_mm_px > 0.0 && e.disparity_step_px > 0.0) {
        const double steps = std::round(disparity_mm_px / (z * e.disparity_step_px));
        z = steps > 0.0 ? disparity_mm_px / (steps * e.disparity_step_px) : 0.0;
      }
      depth_mm[i] = z > 0.0 && at_random >= e.dropout ? static_cast<float>(z) : 0.0f;
    }
  }
  /// Depth of a neighbour beyond an edge, or 0.
  [[nodiscard]] double beyond_edge(std::size_t i) const noexcept {
    const std::size_t column = i % columns_, none = i;
    const double z = seen_mm_[i], widest = kEdgeWidths * z / camera_.fx_px;
    const std::array<std::size_t, 4> around{column > 0 ? i - 1 : none, column + 1 < columns_ ? i + 1 : none,
                                            i >= columns_ ? i - columns_ : none,
                                            i + columns_ < seen_mm_.size() ? i + columns_ : none};
    for (const std::size_t other : around)
      if (seen_mm_[other] > 0.0 && std::abs(seen_mm_[other] - z) > widest) return seen_mm_[other];
    return 0.0;
  }

  std::unique_ptr<SimulatedScene> scene_;
  DepthCamera camera_;
  CameraPath path_;
  SimulatedSensor simulated_;
  std::string name_;
  int threads_;
  std::size_t columns_;
  std::vector<Vec3> rays_;
  std::vector<double> seen_mm_;
  std::vector<std::uint64_t> waiting_;  ///< numbers of captured frames under way, the next one last
  std::uint64_t next_number_ = 0, delivered_ = 0;
  double arrived_s_ = -HUGE_VAL;
};

}  // namespace

std::unique_ptr<DepthSource> make_simulated_camera(std::unique_ptr<SimulatedScene> scene,
                                                   const DepthCamera& camera, CameraPath path,
                                                   const SimulatedSensor& simulated, std::string name,
                                                   int threads) {
  return std::make_unique<SimulatedCamera>(std::move(scene), camera, std::move(path), simulated,
                                           std::move(name), threads);
}

Result<std::unique_ptr<DepthSource>> simulated_camera_of(StockScene stock, std::string name) {
  PALPATE_ASSIGN(std::unique_ptr<SimulatedScene> scene, SimulatedScene::make(std::move(stock.scene)));
  return make_simulated_camera(
      std::move(scene), stock.camera, [pose = stock.world_from_camera](double) { return pose; },
      stock.simulated, std::move(name));
}

Result<std::unique_ptr<DepthSource>> open_simulated_camera(const std::string& spec) {
  PALPATE_ASSIGN(StockScene stock, stock_scene(spec));
  return simulated_camera_of(std::move(stock),
                             spec.starts_with(kSimulatedPrefix) ? spec : kSimulatedPrefix + spec);
}

}  // namespace palpate::stream
