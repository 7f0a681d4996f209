// The frame of renderers that answer model by model: poses taken, forces added up, the god object of the
// strongest shown. The literal forms do so because the thesis does not say how several contacts combine, the
// rivals because their papers know one model.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "toolkit/render/model_pose.h"

namespace palpate::render {

/// What one model answers, in its local coordinates.
struct ModelAnswer {
  bool contact = false;
  bool bound_hit = false;
  Vec3 god_object = Vec3::Zero();
  Vec3 force_n = Vec3::Zero();
};

/// Model: ModelPose& pose(); void reset(const Vec3& h) noexcept; ModelAnswer update(const Vec3& h,
/// FrameCounters&) noexcept. Belongs to one thread. O(models) a frame.
template <class Model>
class SummedModels {
 public:
  void clear(double force_limit_n) noexcept {
    models_.clear();
    force_limit_n_ = force_limit_n;
  }
  void add(std::unique_ptr<Model> model) { models_.push_back(std::move(model)); }
  [[nodiscard]] std::size_t size() const noexcept { return models_.size(); }
  [[nodiscard]] const Model& operator[](std::size_t i) const noexcept { return *models_[i]; }
  [[nodiscard]] const FrameCounters& counters() const noexcept { return counters_; }

  void reset(const Vec3& hip_mm) noexcept {
    counters_ = {};
    now_s_ = 0.0;
    for (const auto& model : models_) {
      model->pose().take(now_s_);
      model->reset(model->pose().to_local(hip_mm));
    }
  }

  [[nodiscard]] Frame step(const Vec3& hip_mm, double dt_s) noexcept {
    ++counters_.frames;
    now_s_ += dt_s;
    Frame frame;
    if (!is_finite(hip_mm)) {
      frame.status = FrameStatus::kNonFinite;
      return frame;
    }
    frame.god_object_mm = hip_mm;
    double strongest_sq = -1.0;
    for (std::size_t i = 0; i < models_.size(); ++i) {
      Model& model = *models_[i];
      model.pose().take(now_s_);
      const ModelAnswer answer = model.update(model.pose().to_local(hip_mm), counters_);
      if (answer.bound_hit) frame.status = FrameStatus::kBoundHit;
      if (!answer.contact) continue;
      frame.contact = true;
      frame.force_n += model.pose().direction_to_world(answer.force_n);
      if (answer.force_n.squaredNorm() <= strongest_sq) continue;
      strongest_sq = answer.force_n.squaredNorm();
      frame.model = static_cast<std::int32_t>(i);
      frame.god_object_mm = model.pose().to_world(answer.god_object);
    }
    counters_.bound_hits += frame.status == FrameStatus::kBoundHit;
    frame.force_n = limited(frame.force_n, force_limit_n_);
    return frame;
  }

 private:
  std::vector<std::unique_ptr<Model>> models_;
  double force_limit_n_ = 0.0;
  double now_s_ = 0.0;
  FrameCounters counters_;
};

}  // namespace palpate::render
