// The renderer of docs/tutorials/your-renderer.md: a ball around each model's points, felt as a spring. It is
// the shortest whole renderer there is, and a bad one: it shows the interface, not an algorithm.
#include "tests/house/example_renderer.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <palpate/clock.h>

namespace palpate::example {
namespace {

using render::Frame;

class BallRenderer final : public render::HapticRenderer {
 public:
  explicit BallRenderer(Options options) : options_(std::move(options)), size_(options_.number("size")) {}

  // What is built and why, told without building it: `palpate info plan` prints it.
  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& scene,
                                                 const render::PrepareContext& /*context*/) const override {
    render::Decisions decided;
    for (const render::ModelInput& model : scene.models) {
      if (model.cloud->empty()) return Error{"the model '" + model.name + "' has no points"};
      render::ModelDecisions one;
      one.name = model.name;
      one.points = model.cloud->size();
      one.bytes = sizeof(Ball);
      one.decisions = {{"ball", std::to_string(2.0 * ball_of(model).radius_mm) + " mm across",
                        "the longest side of the box, times the option size", size_ != 1.0}};
      decided.bytes += one.bytes;
      decided.models.push_back(std::move(one));
    }
    decided.decisions = {render::force_limit_decision(scene.force_limit_n)};
    return decided;
  }

  // Everything that allocates, takes long or can fail happens here. It follows the same decisions.
  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                      const render::PrepareContext& context) override {
    const Stopwatch watch;
    Result<render::Decisions> decided = decide(scene, context);
    if (!decided) return std::move(decided).error();
    for (const render::ModelInput& model : scene.models) balls_.push_back(ball_of(model));
    force_limit_n_ = scene.force_limit_n;
    render::PrepareReport report;
    report.total_ms = watch.ms();
    report.phases = {{"balls", report.total_ms}};
    report.bytes = balls_.size() * sizeof(Ball);
    report.decisions = std::move(decided).value();
    return report;
  }

  void restart(const Vec3& /*hip_mm*/, double /*t_s*/) noexcept override { counters_ = {}; }

  // A ball keeps nothing of what it touches.
  void release_contact(const Vec3& /*hip_mm*/) noexcept override {}

  // No allocation, no lock, no log, no exception; work bounded by the number of models.
  [[nodiscard]] Frame step(const Vec3& hip_mm, double /*t_s*/) noexcept override {
    ++counters_.frames;
    Frame frame;
    frame.god_object_mm = hip_mm;
    if (!is_finite(hip_mm)) {
      frame.status = render::FrameStatus::kNonFinite;
      return frame;
    }
    for (std::size_t i = 0; i < balls_.size(); ++i) {
      const Ball& ball = balls_[i];
      const Vec3 out = hip_mm - ball.centre_mm;
      const double distance_mm = out.norm();
      if (distance_mm >= ball.radius_mm) continue;
      // At the very centre every direction is as good: up.
      const Vec3 normal = distance_mm > 0.0 ? Vec3(out / distance_mm) : Vec3::UnitZ();
      frame.contact = true;
      frame.model = static_cast<std::int32_t>(i);
      frame.god_object_mm = ball.centre_mm + ball.radius_mm * normal;
      frame.force_n =
          render::limited(ball.stiffness_n_per_mm * (frame.god_object_mm - hip_mm), force_limit_n_);
      break;
    }
    return frame;
  }

  [[nodiscard]] render::FrameCounters counters() const noexcept override { return counters_; }

  [[nodiscard]] render::Description describe() const override {
    return {"ball", "a ball around the points, felt as a spring", "docs/tutorials/your-renderer.md",
            "one distance per model", options_};
  }

 private:
  struct Ball {
    Vec3 centre_mm;
    double radius_mm;
    double stiffness_n_per_mm;
  };

  // The spring is computed in world coordinates: a ball looks the same from every side.
  [[nodiscard]] Ball ball_of(const render::ModelInput& model) const {
    const geometry::Aabb box = model.cloud->box_mm();
    return {model.world_from_model * box.centre_mm(), 0.5 * size_ * box.extent_mm().maxCoeff(),
            model.surface.stiffness_n_per_mm};
  }

  Options options_;
  double size_;
  double force_limit_n_ = 0.0;
  std::vector<Ball> balls_;
  render::FrameCounters counters_;
};

}  // namespace

void register_ball(render::Registry& registry) {
  render::RendererInfo info;
  info.name = "ball";
  info.summary = "a ball around the points, felt as a spring";
  info.source = "docs/tutorials/your-renderer.md";
  info.role = render::Role::kOracle;
  info.supports = render::Feature::kManyModels;
  info.options = {{"size",
                   OptionKind::kNumber,
                   "1",
                   "diameter, in units of the longest side of the box",
                   {},
                   0.01,
                   100.0}};
  info.make = [](const Options& options) { return std::make_unique<BallRenderer>(options); };
  registry.add(std::move(info));
}

}  // namespace palpate::example
