// The frame loop shared by the renderers: time, poses, non-finite HIPs, counters, broad phase, contact with
// several models, force limit. Each renderer adds its local model, which renders one model in its own
// coordinates.
#pragma once

#include <palpate/geometry.h>
#include <palpate/renderer.h>
#include <palpate/vec.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "toolkit/render/joint_contact.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/near_models.h"
#include "toolkit/render/surface_response.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::render {

/// limited() for a force whose square overflows: scales the largest component to 1 first. A force with
/// infinite components keeps their direction.
[[nodiscard]] inline Vec3 clamp_huge_force(const Vec3& force_n, double limit_n) noexcept {
  const double largest = force_n.cwiseAbs().maxCoeff();
  Vec3 direction = force_n / largest;
  if (std::isinf(largest))
    for (int axis = 0; axis < 3; ++axis)
      direction[axis] = std::isinf(force_n[axis]) ? std::copysign(1.0, force_n[axis]) : 0.0;
  return direction * (limit_n / direction.norm());
}

/// limited() for any force; takes no square root below the limit.
[[nodiscard]] inline Vec3 clamp_force(const Vec3& force_n, double limit_n) noexcept {
  const double square = force_n.squaredNorm();
  if (square <= limit_n * limit_n) return force_n;
  return std::isinf(square) ? clamp_huge_force(force_n, limit_n) : limited(force_n, limit_n);
}

/// A local model: one model as a renderer feels it, in the model's own coordinates, mm. Belongs to one
/// thread; allocates nothing in a frame. Required:
///   ModelPose& pose()
///   void release_contact(h)          free at h, which is outside the model, in O(1); side and shape stay
///   bool touch(goal, h, memory, contact, status, counters)
///                           moves the HIP to h and pulls the proxy to `goal` (h itself unless other
///                           models hold it elsewhere). Returns true with the frictionless contact
///   SurfaceResponse respond(contact)   the force of that contact, perhaps changed by other models' planes
///   void release()          no force is felt: forgets the friction state
///   Memory                  state that touch() keeps for planes_near()
/// Optional:
///   kTemplatedOnFeatures = true        touch and respond are templates over SurfaceFeature bits;
///                           unsigned features() returns the model's bits
///   void restart(h)         a replay begins at h, if that needs more than release_contact
///   bool touching()         in contact; with geometry::Aabb box_mm(), lets the broad phase skip the model.
///                           Models without both run in every frame
///   void planes_near(memory, at, planes, counters)   the planes that hold the proxy near `at` (world);
///                           default: the plane of the contact
///   kForcesAddUp = true     its forces are summed: no plane can hold the proxy
///   Vec3 body_mm(), double skin_mm(), bool felt(h)   the proxy has a body that other models' planes may
///                           push into this one; the force begins `skin_mm` inside
///   void begin_frame(t_s)   a frame begins, seen by touch() or not
///   void before_frame(counters), bool after_frame(contact, dt_s)   the shape changes; false when it left
///                           box_mm(). bool moves_by_itself(): it may leave the box at any time
///   stream::DepthReceiver* depth_receiver()   takes the depth images of its camera; null without one
template <class Model>
concept LocalModel = requires(Model& model, const Vec3& h, const SurfaceContact& contact) {
  typename Model::Memory;
  { model.pose() } -> std::same_as<ModelPose&>;
  model.release_contact(h);
  model.release();
};

/// A HIP beyond this counts as non-finite: the square of its distance over the square of a cell would
/// overflow a double (1.8e308).
inline constexpr double kMaxHipMm = 1e150;
[[nodiscard]] inline bool is_representable_hip(const Vec3& hip_mm) noexcept {
  return std::abs(hip_mm.x()) + std::abs(hip_mm.y()) + std::abs(hip_mm.z()) <= kMaxHipMm;
}

/// Bound on passes that search for models near the place where the others hold the proxy's body.
inline constexpr int kMaxJointPasses = 3;

template <LocalModel Model>
class FrameLoop {
  static constexpr bool kTemplatedOnFeatures = requires { requires Model::kTemplatedOnFeatures; };
  static constexpr bool kForcesAddUp = requires { requires Model::kForcesAddUp; };
  static constexpr bool kBoxed = requires(const Model& m) {
    m.box_mm();
    m.touching();
  };
  static constexpr bool kHasBody = requires(const Model& m) { m.body_mm(); };
  static constexpr bool kMovesByItself = requires(const Model& m) { m.moves_by_itself(); };
  /// Feature bits of the frame: SurfaceFeature, and "several models or a moving one".
  static constexpr unsigned kFeatureBits = kTemplatedOnFeatures ? kSurfaceFeatures : 1;
  static constexpr unsigned kScene = kFeatureBits;

 public:
  /// Call before prepare() adds models.
  void clear() noexcept {
    models_.clear();
    near_ = NearModels();
  }
  void add(std::unique_ptr<Model> model) { models_.push_back(std::move(model)); }
  /// Traits of the models for decide_scene().
  static constexpr LocalModelTraits kKind{kBoxed, kMovesByItself, kForcesAddUp};

  /// Call after all models are added. Allocates.
  void finish(const SceneDecision& decided, PrepareReport& report) {
    limit_n_ = decided.force_limit_n;
    sums_ = decided.combine == ContactCombination::kSum;
    unsigned features = decided.many ? kScene : 0;
    for (const auto& model : models_)
      if constexpr (kTemplatedOnFeatures) features |= model->features();
    frame_ = composed(std::make_integer_sequence<unsigned, 2 * kScene>{})[features];
    unlimited_ = frame_;
    if (limit_n_ > 0.0) frame_ = &FrameLoop::limited_frame;
    touched_.assign(models_.size(), 0);
    if constexpr (kBoxed)
      if (decided.broad_phase) index_boxes(report);
    all_.resize(models_.size());
    for (std::uint32_t i = 0; i < all_.size(); ++i) all_[i] = i;
    restart(Vec3::Zero(), 0.0);
  }

  [[nodiscard]] std::size_t size() const noexcept { return models_.size(); }
  [[nodiscard]] Model& operator[](std::size_t i) noexcept { return *models_[i]; }
  [[nodiscard]] const Model& operator[](std::size_t i) const noexcept { return *models_[i]; }
  [[nodiscard]] FrameCounters& counters() noexcept { return counters_; }
  [[nodiscard]] const FrameCounters& counters() const noexcept { return counters_; }
  [[nodiscard]] NearModels& near() noexcept { return near_; }

  /// Of the first model with a camera: a scene has one.
  [[nodiscard]] stream::DepthReceiver* depth_receiver() noexcept {
    if constexpr (requires(Model & model) { model.depth_receiver(); })
      for (const auto& model : models_)
        if (stream::DepthReceiver* const receiver = model->depth_receiver()) return receiver;
    return nullptr;
  }

  void restart(const Vec3& hip_mm, double t_s) noexcept {
    counters_ = {};
    time_.restart(t_s);
    for (const auto& model : models_) {
      model->pose().take(t_s);
      const Vec3 h = model->pose().to_local(hip_mm);
      if constexpr (requires { model->restart(h); })
        model->restart(h);
      else
        model->release_contact(h);
    }
    near_.restart(hip_mm, t_s, [](std::uint32_t, const Vec3&, double) noexcept {});
  }

  void release_contact(const Vec3& hip_mm) noexcept {
    time_.release_contact();
    for (std::uint32_t i = 0; i < models_.size(); ++i) enter(i, hip_mm, time_.now_s());
    near_.release_contact(hip_mm);
  }

  /// Calls the frame function composed in preparation for the scene's features.
  [[nodiscard]] Frame step(const Vec3& hip_mm, double t_s) noexcept { return (this->*frame_)(hip_mm, t_s); }

 private:
  struct Touch {
    Model* owner = nullptr;
    std::int32_t model = -1;
    typename Model::Memory memory;
    SurfaceContact contact;  ///< local
    [[nodiscard]] const ModelPose& pose() const noexcept { return owner->pose(); }
  };

  using FrameFunction = Frame (FrameLoop::*)(const Vec3&, double) noexcept;
  template <unsigned... kFeatures>
  static constexpr std::array<FrameFunction, sizeof...(kFeatures)> composed(
      std::integer_sequence<unsigned, kFeatures...>) noexcept {
    return {&FrameLoop::frame<kFeatures>...};
  }

  void index_boxes(PrepareReport& report) {
    std::vector<ModelBox> boxes;
    for (const auto& model : models_) {
      const ModelPose& pose = model->pose();
      const geometry::Aabb local = model->box_mm();
      boxes.push_back({{local.low_mm + pose.origin_mm, local.high_mm + pose.origin_mm},
                       pose.world_from_model,
                       pose.motion});
    }
    near_.build(std::move(boxes));
    if constexpr (requires { models_[0]->moves_by_itself(); })
      for (std::uint32_t i = 0; i < models_.size(); ++i)
        if (models_[i]->moves_by_itself()) near_.mark_always_near(i);
    report.bytes += near_.bytes();
  }

  /// Wraps the frame in scenes with a force limit; not called in others.
  Frame limited_frame(const Vec3& hip_mm, double t_s) noexcept {
    Frame frame = (this->*unlimited_)(hip_mm, t_s);
    frame.force_n = clamp_force(frame.force_n, limit_n_);
    return frame;
  }

  /// One model at rest ignores the time.
  template <unsigned kFeatures>
  Frame frame(const Vec3& hip_mm, [[maybe_unused]] double t_s) noexcept {
    if constexpr ((kFeatures & kScene) != 0) dt_s_ = time_.advance(t_s);
    ++counters_.frames;
    Frame frame;
    if (!is_representable_hip(hip_mm)) {
      frame.status = FrameStatus::kNonFinite;
      return frame;
    }
    frame.god_object_mm = hip_mm;
    if constexpr (requires(Model & model) { model.begin_frame(t_s); })
      for (const auto& model : models_) model->begin_frame(t_s);
    if constexpr ((kFeatures & kScene) != 0)
      many<kFeatures & ~kScene>(hip_mm, frame);
    else
      single<kFeatures>(hip_mm, frame);
    counters_.bound_hits += frame.status == FrameStatus::kBoundHit;
    return frame;
  }

  template <unsigned kFeatures>
  bool touch(Model& model, const Vec3& goal, const Vec3& h, typename Model::Memory& memory,
             SurfaceContact& contact, FrameStatus& status) noexcept {
    if constexpr (kTemplatedOnFeatures)
      return model.template touch<kFeatures>(goal, h, memory, contact, status, counters_);
    else
      return model.touch(goal, h, memory, contact, status, counters_);
  }
  template <unsigned kFeatures>
  static SurfaceResponse respond(Model& model, const SurfaceContact& contact) noexcept {
    if constexpr (kTemplatedOnFeatures)
      return model.template respond<kFeatures>(contact);
    else
      return model.respond(contact);
  }

  template <unsigned kFeatures>
  void single(const Vec3& hip_mm, Frame& frame) noexcept {
    Model& model = *models_.front();
    const Vec3 h = model.pose().to_local(hip_mm);
    typename Model::Memory memory;
    SurfaceContact contact;
    if (touch<kFeatures>(model, h, h, memory, contact, frame.status))
      answer<kFeatures>(model, 0, contact, h, frame);
    else if constexpr (!kTemplatedOnFeatures || kFeatures != 0)
      model.release();
  }

  /// A frame with one contact.
  template <unsigned kFeatures>
  void answer(Model& model, std::int32_t index, const SurfaceContact& contact, [[maybe_unused]] const Vec3& h,
              Frame& frame) noexcept {
    if constexpr (kHasBody) {
      if (!model.felt(h)) {
        model.release();
        return;
      }
    }
    const SurfaceResponse answer = respond<kFeatures>(model, contact);
    frame.contact = true;
    frame.model = index;
    frame.god_object_mm = model.pose().to_world(answer.god_object_mm);
    frame.force_n = model.pose().direction_to_world(answer.force_n);
  }

  /// A frame over the models near the HIP, each at its current pose. The HIP's motion is taken in each
  /// model's frame, so a model that moves onto a resting HIP meets it.
  template <unsigned kFeatures>
  void many(const Vec3& hip_mm, Frame& frame) noexcept {
    choose(hip_mm);
    for (const std::uint32_t index : looked_at()) {
      models_[index]->pose().take(time_.now_s());
      touched_[index] = 0;
      if constexpr (requires(Model & m) { m.before_frame(counters_); })
        models_[index]->before_frame(counters_);
    }
    touches_.clear();
    find_touches<kFeatures>(hip_mm, hip_mm, frame);
    hold<kFeatures>(hip_mm, frame);
    for (const std::uint32_t index : looked_at())
      if (touched_[index] == 0) models_[index]->release();
    near_.done(hip_mm, time_.now_s());
    answer_all<kFeatures>(hip_mm, frame);
    if constexpr (requires(Model & m, const SurfaceContact& c) { m.after_frame(c, 0.0); })
      for (Touch& touch : touches_.all())
        if (!touch.owner->after_frame(touch.contact, dt_s_))
          near_.keep_near(static_cast<std::uint32_t>(touch.model));
  }

  void choose([[maybe_unused]] const Vec3& hip_mm) noexcept {
    if constexpr (kBoxed)
      near_.choose(
          hip_mm, time_.now_s(),
          [this](std::uint32_t i, const Vec3& hip, double t_s) noexcept { enter(i, hip, t_s); },
          [this](std::uint32_t i) noexcept { return models_[i]->touching(); });
  }
  [[nodiscard]] std::span<const std::uint32_t> looked_at() const noexcept {
    if constexpr (kBoxed)
      return near_.models();
    else
      return all_;
  }

  /// Adds near models that a proxy pulled to `goal_mm` touches and that were not touched yet. True if there
  /// were any.
  template <unsigned kFeatures>
  bool find_touches(const Vec3& goal_mm, const Vec3& hip_mm, Frame& frame) noexcept {
    bool any = false;
    for (const std::uint32_t index : looked_at()) {
      if (touched_[index] != 0) continue;
      Model& model = *models_[index];
      Touch& touched = touches_.next();
      if (!touch<kFeatures>(model, model.pose().to_local(goal_mm), model.pose().to_local(hip_mm),
                            touched.memory, touched.contact, frame.status))
        continue;
      touched.owner = &model;
      touched.model = static_cast<std::int32_t>(index);
      touched_[index] = 1;
      any = true;
      if (touches_.keep()) continue;
      // The model stays in contact but exerts no force, so its friction state ends.
      touches_.next().owner->release();
      frame.status = FrameStatus::kBoundHit;
    }
    return any;
  }

  /// Lets several touched models hold one god object. The place that holds a proxy's body may be inside a
  /// model that the HIP does not touch.
  template <unsigned kFeatures>
  void hold(const Vec3& hip_mm, Frame& frame) noexcept {
    if constexpr (kHasBody) {
      for (int pass = 1; !touches_.all().empty(); ++pass) {
        const Vec3 body = hold_together(hip_mm);
        if (pass == kMaxJointPasses || sums_) return;
        if (!find_touches<kFeatures>(body, hip_mm, frame)) return;
      }
    } else if constexpr (!kForcesAddUp) {
      if (touches_.all().size() > 1 && !sums_) (void)hold_together(hip_mm);
    }
  }

  /// The place where the touched models hold the proxy; distributes the pull over several models.
  Vec3 hold_together(const Vec3& hip_mm) noexcept {
    const std::span<Touch> touches = touches_.all();
    double skin = 0.0;
    if constexpr (kHasBody) {
      const Touch& first = touches.front();
      if (touches.size() == 1 || sums_) return first.pose().to_world(first.owner->body_mm());
      for (const Touch& touch : touches) skin = std::max(skin, touch.owner->skin_mm());
    }
    return constrain_jointly(
        hip_mm, touches,
        [&](Touch& touch, [[maybe_unused]] const Vec3& at, JointPlanes& planes) noexcept {
          if constexpr (requires { touch.owner->planes_near(touch.memory, at, planes, counters_); })
            touch.owner->planes_near(touch.memory, at, planes, counters_);
          else
            add_plane(touch, planes);
        },
        skin);
  }
  /// The plane through a contact's god object, perpendicular to its pull.
  static void add_plane(const Touch& touch, JointPlanes& planes) noexcept {
    const double depth = touch.contact.pull.norm();
    if (!(depth > 0.0)) return;
    const Vec3 normal = touch.pose().direction_to_world(touch.contact.pull / depth);
    planes.add({normal, normal.dot(touch.pose().to_world(touch.contact.hip + touch.contact.pull))});
  }

  /// A frame with several touches.
  template <unsigned kFeatures>
  void answer_all(const Vec3& hip_mm, Frame& frame) noexcept {
    const std::span<Touch> touches = touches_.all();
    if (touches.empty()) return;
    if (touches.size() == 1) {
      Touch& only = touches.front();
      answer<kFeatures>(*only.owner, only.model, only.contact, only.pose().to_local(hip_mm), frame);
      return;
    }
    if constexpr (kHasBody) {
      const bool any = std::any_of(touches.begin(), touches.end(),
                                   [](const Touch& touch) { return touch.contact.pull != Vec3::Zero(); });
      if (!any) {  // the skin is under no surface
        for (const Touch& touch : touches) touch.owner->release();
        return;
      }
    }
    sum_responses(
        touches, [](Touch& touch) noexcept { return respond<kFeatures>(*touch.owner, touch.contact); },
        frame);
  }

  /// A model that comes near starts its contact at the last place, where the HIP was outside it.
  void enter(std::uint32_t index, const Vec3& hip_mm, double t_s) noexcept {
    Model& model = *models_[index];
    model.pose().take(t_s);
    model.release_contact(model.pose().to_local(hip_mm));
  }

  std::vector<std::unique_ptr<Model>> models_;
  std::vector<std::uint8_t> touched_;  ///< per model, in this frame
  std::vector<std::uint32_t> all_;     ///< 0, 1, 2, ..
  Touches<Touch> touches_;
  NearModels near_;  ///< built for several or moving models
  FrameFunction frame_ = nullptr;
  FrameFunction unlimited_ = nullptr;
  bool sums_ = false;
  double limit_n_ = 0.0;  ///< 0 = none
  double dt_s_ = 0.0;
  FrameTime time_;
  FrameCounters counters_;
};

}  // namespace palpate::render
