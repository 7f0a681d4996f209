// The renderer around a rival's model: the common part of all point-based rivals.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <palpate/registry.h>
#include <palpate/result.h>
#include "baselines/option_specs.h"
#include "baselines/points/gaps.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {

/// A rival's answer in a frame, local coordinates.
struct RivalAnswer {
  bool contact = false;
  bool bound_hit = false;
  Vec3 pull = Vec3::Zero();     ///< with a god object: from the HIP to it
  Vec3 force_n = Vec3::Zero();  ///< without a god object
};

/// Input of a rival's decision and preparation; notes, bytes and phases go to the report.
struct RivalInput {
  const render::ModelInput& input;
  const Options& options;
  const render::PrepareContext& context;
  render::PrepareReport& report;
};

/// Common state of all rivals' models. Belongs to one thread.
struct RivalModel {
  render::ModelPose place;
  render::SurfaceField surface;
  render::SurfaceState state;  ///< with a god object

  [[nodiscard]] render::ModelPose& pose() noexcept { return place; }
  [[nodiscard]] const render::ModelPose& pose() const noexcept { return place; }
  void release() noexcept { state.release(); }
  /// A penalty's answer: pushed out by `pull`.
  [[nodiscard]] RivalAnswer push(const Vec3& pull) const noexcept {
    return {true, false, pull, surface.stiffness_n_per_mm * pull};
  }
};

/// Whether the force counts from a proxy that stays off the points, as in the sources, or from the surface
/// that it touches.
inline OptionSpec offset_spec() {
  return option::choice("offset", "removed",
                        "the distance that the proxy stays off the points: removed (the HIP is a point) or "
                        "kept, as in the source (the tool is a sphere)",
                        {"removed", "kept"});
}
inline bool is_offset_kept(const Options& options) {
  return options.text("offset") == "kept";
}
inline render::Decision offset_decision(bool kept) {
  return kept ? render::Decision{"offset", "kept", "as given: the tool has the proxy's size", true}
              : render::Decision{"offset", "removed", "the HIP is a point"};
}

/// Origin of a rival.
struct RivalText {
  const char* name;
  const char* summary;
  const char* source;
  // Measured estimates at 1,002,001 points (docs/results/rivals.md): median contact frame, and preparation.
  double frame_us;
  double ms_per_million;
};

/// Model: derived from RivalModel, with
///   static constexpr RivalText kText;
///   static constexpr bool kGodObject;  friction and texture need one
///   static constexpr bool kFollowsPoints;  only where points that move from outside are followed
///   static std::vector<OptionSpec> specs();
///   Status decide(const RivalInput&, ModelDecisions&);  sets the model's numbers and says them; builds
///   nothing Status prepare(const RivalInput&);  builds what the numbers say std::string work_bound() const;
///   of a frame with this model void release_contact(const Vec3&) noexcept;  where a replay needs more, void
///   restart(const Vec3&) noexcept; of streams stream::DepthReceiver* depth_receiver() noexcept; RivalAnswer
///   update(const Vec3&, FrameCounters&) noexcept.
/// As a local model of the frame loop: friction and texture as on every other renderer where it has a god
/// object, which is then held jointly with other models'.
template <class Model>
class LocalRival final : public Model {
 public:
  struct Memory {};
  static constexpr bool kForcesAddUp = !Model::kGodObject;

  void release_contact(const Vec3& h) noexcept {
    Model::release_contact(h);
    Model::release();
    // A free frame: models that judge sides by the place they look from do so now.
    render::FrameCounters uncounted;
    (void)Model::update(h, uncounted);
  }
  void restart(const Vec3& h) noexcept {
    if constexpr (requires(Model & model) { model.restart(h); })
      Model::restart(h);
    else
      Model::release_contact(h);
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
  [[nodiscard]] render::SurfaceResponse respond(const render::SurfaceContact& contact) noexcept {
    if constexpr (kForcesAddUp)
      return {force_n_, contact.hip + contact.pull};
    else
      return render::respond_for_features(Model::state, Model::surface, contact, Model::place.origin_mm);
  }

 private:
  Vec3 force_n_ = Vec3::Zero();  ///< of the last touch, without a god object
};

/// The features that a scene may ask of it.
template <class Model>
[[nodiscard]] constexpr render::Features rival_features() {
  using render::Feature;
  render::Features feels = Feature::kSoftness | Feature::kMotion | Feature::kManyModels;
  if constexpr (requires { Model::kFollowsPoints; }) feels |= Feature::kMovedPoints;
  if (Model::kGodObject) feels |= Feature::kFriction | Feature::kTexture | Feature::kJointContact;
  return feels;
}

template <class Model>
class RivalRenderer final : public render::FrameLoopRenderer<LocalRival<Model>> {
  using Shell = render::FrameLoopRenderer<LocalRival<Model>>;
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
      PALPATE_ASSIGN(render::ModelDecisions decided, set_numbers(*model, input, context, report));
      report.decisions.models.push_back(std::move(decided));
      PALPATE_ASSIGN(model->surface, render::build_uniform_surface_field(input.surface, report));
      model->place = render::ModelPose(input, input.cloud->origin_mm);
      PALPATE_TRY(model->prepare({input, options_, context, report}));
      models_.add(std::move(model));
    }
    return Done{};
  }
  /// Sets the model's numbers before anything is built.
  Result<render::ModelDecisions> set_numbers(LocalRival<Model>& model, const render::ModelInput& input,
                                             const render::PrepareContext& context,
                                             render::PrepareReport& report) const {
    PALPATE_TRY(check(input));
    PALPATE_ASSIGN(const render::SurfaceDecision surface, render::decide_surface(input));
    render::ModelDecisions out;
    out.name = input.name;
    out.points = input.cloud->size();
    out.frame_us = Model::kText.frame_us;
    out.prepare_ms = Model::kText.ms_per_million * 1e-6 * static_cast<double>(out.points);
    PALPATE_TRY(model.decide({input, options_, context, report}, out));
    render::describe_surface(input, surface, rival_features<Model>(), out.points, out);
    return out;
  }
  static Status check(const render::ModelInput& input) {
    if (input.cloud->empty())
      return Error{"the model '" + input.name + "' has no points", "give a file with at least one point"};
    if (input.surface.per_point == nullptr) return Done{};
    return Error{"model '" + input.name + "' has properties that differ from point to point",
                 std::string(Model::kText.name) +
                     " takes one value for the whole model: leave out regions and columns"};
  }
};

template <class Model>
[[nodiscard]] render::RendererInfo rival_info() {
  render::RendererInfo info;
  info.name = Model::kText.name;
  info.summary = Model::kText.summary;
  info.source = Model::kText.source;
  info.supports = rival_features<Model>();
  info.options = Model::specs();
  info.make = [](const Options& options) { return std::make_unique<RivalRenderer<Model>>(options); };
  return info;
}

}  // namespace palpate::baselines
