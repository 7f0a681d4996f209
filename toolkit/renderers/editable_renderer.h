// The common part of renderers whose models deform.
#pragma once

#include <fmt/format.h>

#include <memory>
#include <utility>

#include "toolkit/deformation/deformer.h"
#include "toolkit/render/frame_loop_renderer.h"

namespace palpate::render {

/// Model: DeformationState deformation; put_back(counters, change) runs change(on_moved), which changes
/// points and tells the contact by on_moved(place, from, to).
template <LocalModel Model>
class EditableRenderer : public FrameLoopRenderer<Model>, public Editable {
 public:
  bool undo(std::size_t model) noexcept override {
    Deformer* const deformer = deformer_of(model);
    if (deformer == nullptr) return false;
    bool any = false;
    put_back(model, [&](auto&& on_moved) noexcept { any = deformer->undo(on_moved); });
    return any;
  }
  void restore(std::size_t model) noexcept override {
    Deformer* const deformer = deformer_of(model);
    if (deformer == nullptr) return;
    put_back(model, [&](auto&& on_moved) noexcept { deformer->reset(on_moved); });
  }
  Result<cloud::Cloud> edited(std::size_t model) const override {
    if (const Deformer* const deformer = deformer_of(model)) return deformer->edited();
    return Error{"this model does not give way", "give it a [model.surface.dent]", {}, 0};
  }
  std::optional<Vec3> point_position_mm(std::size_t model, std::uint32_t point) const noexcept override {
    const Deformer* const deformer = deformer_of(model);
    if (deformer == nullptr) return std::nullopt;
    return deformer->point_mm(point);
  }
  DeformCounters deform_counters(std::size_t model) const noexcept override {
    const Deformer* const deformer = deformer_of(model);
    return deformer == nullptr ? DeformCounters{} : deformer->counters();
  }

 protected:
  using FrameLoopRenderer<Model>::FrameLoopRenderer;

  static void describe_deformation(const char* how, const DeformerCapacity& room, ModelDecisions& out) {
    out.decisions.push_back({"deformable geometry", how,
                             fmt::format("up to {} points a frame, {} spare ones, {} changes undone; the "
                                         "first shape is kept",
                                         kMaxMovedPoints, room.spare_points, room.journal_points),
                             true});
  }
  static void begin_deformation(DeformationState& deformation, const ModelInput& input,
                                std::unique_ptr<MovablePoints> points, const DeformerCapacity& room,
                                const geometry::Aabb& prepared_box_mm, PrepareReport& report) {
    deformation.begin(input, std::move(points), room.journal_points, prepared_box_mm);
    report.bytes += deformation.deformer()->bytes();
    report.notes.push_back(
        fmt::format("deformation: up to {} points a frame, {} spare ones, {} changes undone", kMaxMovedPoints,
                    room.spare_points, room.journal_points));
  }

 private:
  [[nodiscard]] Deformer* deformer_of(std::size_t model) const noexcept {
    return model < this->models_.size() ? this->models_[model].deformation.deformer() : nullptr;
  }
  template <class Change>
  void put_back(std::size_t model, Change&& change) noexcept {
    this->models_[model].put_back(this->models_.counters(), std::forward<Change>(change));
  }
};

}  // namespace palpate::render
