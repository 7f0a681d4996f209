#include "toolkit/renderers/cloud_renderer.h"

#include <algorithm>
#include <utility>

#include "toolkit/deformation/editable.h"
#include "toolkit/points/point_model.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/slow_phase.h"
#include "toolkit/renderers/cloud_on_stars.h"
#include "toolkit/renderers/cloud_on_vertices.h"
#include "toolkit/stars/refine.h"

namespace palpate::render {
namespace {

/// Options that only the surface of vertices has.
std::vector<OptionSpec> vertex_specs() {
  std::vector<OptionSpec> specs = point_model_specs();
  for (OptionSpec& spec : specs) {
    if (spec.key != "cell") continue;
    spec.default_value = "0";
    spec.only_with = {{"partition", {"grid"}}};  // the leaves of a tree choose their own sizes
  }
  for (OptionSpec& spec : box_test_specs()) specs.push_back(std::move(spec));
  specs.push_back(partition_spec());
  specs.push_back(shading_spec("force shading; auto: facet where stiffness x local spacing is felt"));
  for (OptionSpec& spec : specs) spec.only_with.push_back({"surface", {"auto", "vertices"}});
  return specs;
}

/// One of the two surfaces, chosen once the scene is known.
class CloudRenderer final : public HapticRenderer, public Editable, public SlowPhase {
 public:
  explicit CloudRenderer(const Options& options) : options_(options) {
    const std::vector<OptionSpec> specs = vertex_specs();
    asked_vertices_ = options.text("surface") == "vertices" ||
                      std::any_of(specs.begin(), specs.end(), [&](const OptionSpec& spec) {
                        return options.has(spec.key) && options.text(spec.key) != spec.default_value;
                      });
    made_ = make(asked_vertices_);
  }

  Result<Decisions> decide(const SceneInput& scene, const PrepareContext& context) const override {
    if (const Status right = check(scene); !right) return right.error();
    return make(on_vertices(scene))->decide(scene, context);
  }
  Result<PrepareReport> prepare(const SceneInput& scene, const PrepareContext& context) override {
    if (const Status right = check(scene); !right) return right.error();
    made_ = make(on_vertices(scene));
    editable_ = dynamic_cast<Editable*>(made_.get());
    slow_ = dynamic_cast<SlowPhase*>(made_.get());
    return made_->prepare(scene, context);
  }
  void restart(const Vec3& hip_mm, double t_s) noexcept override { made_->restart(hip_mm, t_s); }
  void let_go(const Vec3& hip_mm) noexcept override { made_->let_go(hip_mm); }
  [[nodiscard]] Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    return made_->step(hip_mm, t_s);
  }
  [[nodiscard]] FrameCounters counters() const noexcept override { return made_->counters(); }
  [[nodiscard]] Description describe() const override { return made_->describe(); }

  bool undo(std::size_t model) noexcept override { return editable_ != nullptr && editable_->undo(model); }
  void restore(std::size_t model) noexcept override {
    if (editable_ != nullptr) editable_->restore(model);
  }
  [[nodiscard]] Result<cloud::Cloud> edited(std::size_t model) const override {
    if (editable_ == nullptr)
      return Error{"this model does not give way", "give it a [model.surface.dent]", {}, 0};
    return editable_->edited(model);
  }
  [[nodiscard]] DeformCounters deform_counters(std::size_t model) const noexcept override {
    return editable_ == nullptr ? DeformCounters{} : editable_->deform_counters(model);
  }
  void run_slow_phase_elsewhere() noexcept override {
    if (slow_ != nullptr) slow_->run_slow_phase_elsewhere();
  }
  void slow_phase(double t_s, const Vec3& from_mm, const Vec3& to_mm) noexcept override {
    if (slow_ != nullptr) slow_->slow_phase(t_s, from_mm, to_mm);
  }

 private:
  static bool gives_way(const SceneInput& scene) {
    return std::any_of(scene.models.begin(), scene.models.end(), [](const ModelInput& input) {
      return input.surface.dent.any() || input.moves != nullptr;
    });
  }
  [[nodiscard]] Status check(const SceneInput& scene) const {
    if (options_.text("surface") == "stars" && gives_way(scene))
      return Error{"a surface of stars does not give way, and a model of the scene does",
                   "leave out surface=stars, or take surface=vertices",
                   {},
                   0};
    return Done{};
  }
  [[nodiscard]] bool on_vertices(const SceneInput& scene) const {
    return asked_vertices_ || gives_way(scene);
  }
  [[nodiscard]] std::unique_ptr<HapticRenderer> make(bool vertices) const {
    return vertices ? make_cloud_on_vertices(options_) : make_cloud_on_stars(options_);
  }

  Options options_;
  bool asked_vertices_ = false;
  std::unique_ptr<HapticRenderer> made_;
  Editable* editable_ = nullptr;  ///< made_, where it is one
  SlowPhase* slow_ = nullptr;
};

}  // namespace

RendererInfo cloud_info() {
  RendererInfo info;
  info.name = "cloud";
  info.summary = "chapter 3 made right: the points' own triangles, a god object that only descends";
  info.source =
      "El-Far, chapter 3; stars of points, contact side, friction cone, joint contact and bounds are ours";
  info.role = Role::kOurs;
  info.supports = kFeltOnVertices;
  info.options = vertex_specs();
  info.options.push_back({"combine",
                          OptionKind::kChoice,
                          "joint",
                          "several models touched at once: constrained jointly, or the sum of their forces",
                          {"joint", "sum"}});
  info.options.push_back(
      {"surface",
       OptionKind::kChoice,
       "auto",
       "what is felt: triangles that the points agree on (stars), or a plane at every point; auto: stars, "
       "unless points give way or an option of the vertices is given",
       {"auto", "stars", "vertices"}});
  info.options.push_back({"refine",
                          OptionKind::kInteger,
                          "0",
                          "times that every triangle is cut into four on curves through the points: half the "
                          "error and four times the memory each",
                          {},
                          0.0,
                          static_cast<double>(stars::kMostRefined),
                          {{"surface", {"auto", "stars"}}}});
  info.make = [](const Options& options) { return std::make_unique<CloudRenderer>(options); };
  return info;
}

}  // namespace palpate::render
