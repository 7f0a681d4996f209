// The renderer around a rival's model: everything that is the same for all point-based rivals.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "toolkit/core/try.h"
#include "toolkit/render/registry.h"
#include "toolkit/render/shell_renderer.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {

/// What a rival answers in a frame, in its local coordinates.
struct RivalAnswer {
  bool contact = false;
  bool bound_hit = false;
  Vec3 pull = Vec3::Zero();     ///< of rivals with a god object: the way from the HIP to it
  Vec3 force_n = Vec3::Zero();  ///< of the others
};

/// What every rival's model has beside its own data. Belongs to one thread.
struct RivalModel {
  render::ModelPose place;
  render::SurfaceField surface;
  render::SurfaceState state;  ///< of rivals with a god object

  [[nodiscard]] render::ModelPose& pose() noexcept { return place; }
  [[nodiscard]] const render::ModelPose& pose() const noexcept { return place; }
  void release() noexcept { state.release(); }
  /// The answer of a penalty: pushed out by `pull`.
  [[nodiscard]] RivalAnswer push(const Vec3& pull) const noexcept {
    return {true, false, pull, surface.stiffness_n_per_mm * pull};
  }
};

/// Where a rival comes from.
struct RivalText {
  const char* name;
  const char* summary;
  const char* source;
  // Measured at 1,002,001 points (docs/rivals.md), what to expect: the median frame in contact, and
  // preparation.
  double frame_us;
  double ms_per_million;
};

/// Model: derived from RivalModel, with
///   static constexpr RivalText kText;
///   static constexpr bool kGodObject;  friction and texture need one
///   static constexpr bool kFollowsPoints;  only where points that move from outside are followed
///   static std::vector<OptionSpec> specs();
///   static Status decide(Model&, const ModelInput&, const Options&, const PrepareContext&, PrepareReport&,
///                        ModelDecisions&);  sets the model's numbers and says them; builds nothing
///   static Status prepare(Model&, const ModelInput&, const Options&, const PrepareContext&, PrepareReport&);
///                        builds what the numbers say
///   std::string work_bound() const;  of a frame with this model
///   void let_go(const Vec3&) noexcept; where a replay needs more, void restart(const Vec3&) noexcept
///   RivalAnswer update(const Vec3&, FrameCounters&) noexcept.
/// As a local model of the frame shell: friction and texture as on every other renderer where it has a god
/// object, which is then held jointly with other models'.
template <class Model>
class LocalRival final : public Model {
 public:
  struct Memory {};
  static constexpr bool kSums = !Model::kGodObject;

  void let_go(const Vec3& h) noexcept {
    Model::let_go(h);
    Model::release();
    // A free frame there: where a model judges sides by the place it looks from, it does so now.
    render::FrameCounters uncounted;
    (void)Model::update(h, uncounted);
  }
  void restart(const Vec3& h) noexcept {
    if constexpr (requires(Model & model) { model.restart(h); })
      Model::restart(h);
    else
      Model::let_go(h);
    Model::release();
  }
  [[nodiscard]] bool touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/,
                           render::SurfaceContact& contact, render::FrameStatus& status,
                           render::FrameCounters& counters) noexcept {
    const RivalAnswer answer = Model::update(h, counters);
    if (answer.bound_hit) status = render::FrameStatus::kBoundHit;
    if (!answer.contact) return false;
    contact = render::uniform_contact(Model::surface, h, answer.pull);
    force_n_ = answer.force_n;
    return true;
  }
  [[nodiscard]] render::SurfaceAnswer respond(const render::SurfaceContact& contact) noexcept {
    if constexpr (kSums)
      return {force_n_, contact.hip + contact.pull};
    else
      return render::respond_as_asked(Model::state, Model::surface, contact, Model::place.origin_mm);
  }

 private:
  Vec3 force_n_ = Vec3::Zero();  ///< of the last touch, where there is no god object
};

/// What a scene may ask of it.
template <class Model>
[[nodiscard]] constexpr render::Features rival_feels() {
  using render::Feature;
  render::Features feels = Feature::kSoftness | Feature::kMotion | Feature::kManyModels;
  if constexpr (requires { Model::kFollowsPoints; }) feels |= Feature::kMovedPoints;
  if (Model::kGodObject) feels |= Feature::kFriction | Feature::kTexture | Feature::kJointContact;
  return feels;
}

template <class Model>
class RivalRenderer final : public render::ShellRenderer<LocalRival<Model>> {
  using Shell = render::ShellRenderer<LocalRival<Model>>;
  using Shell::models_;
  using Shell::options_;

 public:
  explicit RivalRenderer(const Options& options) : Shell(options) {}

  render::Description describe() const override {
    return {Model::kText.name, Model::kText.summary, Model::kText.source,
            models_.size() > 0 ? models_[0].work_bound() : Model().work_bound(), options_};
  }

 private:
  Result<render::ModelDecisions> decide_model(const render::ModelInput& input,
                                              const render::PrepareContext& context) const override {
    render::PrepareReport unused;
    LocalRival<Model> model;
    return set_numbers(model, input, context, unused);
  }
  Status add_models(const render::SceneInput& scene, const render::PrepareContext& context,
                    render::PrepareReport& report) override {
    for (const render::ModelInput& input : scene.models) {
      auto model = std::make_unique<LocalRival<Model>>();
      Result<render::ModelDecisions> decided = set_numbers(*model, input, context, report);
      if (!decided.ok()) return std::move(decided).error();
      report.decisions.models.push_back(std::move(decided).value());
      Result<render::SurfaceField> surface = render::build_uniform_surface_field(input.surface, report);
      if (!surface.ok()) return std::move(surface).error();
      model->surface = std::move(surface).value();
      model->place = render::ModelPose(input, input.cloud->origin_mm);
      PALPATE_TRY(Model::prepare(*model, input, options_, context, report));
      models_.add(std::move(model));
    }
    return Done{};
  }
  /// The model's numbers, not yet what they are the numbers of.
  Result<render::ModelDecisions> set_numbers(LocalRival<Model>& model, const render::ModelInput& input,
                                             const render::PrepareContext& context,
                                             render::PrepareReport& report) const {
    PALPATE_TRY(check(input));
    const Result<render::SurfaceDecision> surface = render::decide_surface(input);
    if (!surface.ok()) return surface.error();
    render::ModelDecisions out;
    out.name = input.name;
    out.points = input.cloud->size();
    out.frame_us = Model::kText.frame_us;
    out.prepare_ms = Model::kText.ms_per_million * 1e-6 * static_cast<double>(out.points);
    PALPATE_TRY(Model::decide(model, input, options_, context, report, out));
    render::say_surface(input, *surface, rival_feels<Model>(), out.points, out);
    return out;
  }
  static Status check(const render::ModelInput& input) {
    if (input.cloud->empty())
      return Error{
          "the model '" + input.name + "' has no points", "give a file with at least one point", {}, 0};
    if (input.surface.per_point == nullptr) return Done{};
    return Error{"model '" + input.name + "' has properties that differ from point to point",
                 std::string(Model::kText.name) +
                     " takes one value for the whole model: leave out regions and columns",
                 {},
                 0};
  }
};

template <class Model>
[[nodiscard]] render::RendererInfo rival_info() {
  render::RendererInfo info;
  info.name = Model::kText.name;
  info.summary = Model::kText.summary;
  info.source = Model::kText.source;
  info.supports = rival_feels<Model>();
  info.options = Model::specs();
  info.make = [](const Options& options) { return std::make_unique<RivalRenderer<Model>>(options); };
  return info;
}

}  // namespace palpate::baselines
