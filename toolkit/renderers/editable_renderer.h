// What the renderers have in common whose models give way.
#pragma once

#include <fmt/format.h>

#include <memory>
#include <utility>

#include "toolkit/deformation/editable.h"
#include "toolkit/deformation/giving_way.h"
#include "toolkit/render/shell_renderer.h"

namespace palpate::render {

/// Model: GivingWay giving; put_back(counters, change) changes the points by change(told), told(place, from,
/// to) telling the contact.
template <LocalModel Model>
class EditableShellRenderer : public ShellRenderer<Model>, public Editable {
 public:
  bool undo(std::size_t model) noexcept override {
    Deformer* const deformer = deformer_of(model);
    if (deformer == nullptr) return false;
    bool any = false;
    put_back(model, [&](auto&& told) noexcept { any = deformer->undo(told); });
    return any;
  }
  void restore(std::size_t model) noexcept override {
    Deformer* const deformer = deformer_of(model);
    if (deformer == nullptr) return;
    put_back(model, [&](auto&& told) noexcept { deformer->reset(told); });
  }
  Result<cloud::Cloud> edited(std::size_t model) const override {
    if (const Deformer* const deformer = deformer_of(model)) return deformer->edited();
    return Error{"this model does not give way", "give it a [model.surface.dent]", {}, 0};
  }
  std::optional<Vec3> place_mm(std::size_t model, std::uint32_t point) const noexcept override {
    const Deformer* const deformer = deformer_of(model);
    if (deformer == nullptr) return std::nullopt;
    return deformer->point_mm(point);
  }
  DeformCounters deform_counters(std::size_t model) const noexcept override {
    const Deformer* const deformer = deformer_of(model);
    return deformer == nullptr ? DeformCounters{} : deformer->counters();
  }

 protected:
  using ShellRenderer<Model>::ShellRenderer;

  static void say_giving_way(const char* how, const DeformerRoom& room, ModelDecisions& out) {
    out.decisions.push_back({"deformable geometry", how,
                             fmt::format("up to {} points a frame, {} spare ones, {} changes undone; the "
                                         "first shape is kept",
                                         kMaxMovedPoints, room.spare_points, room.journal_points),
                             true});
  }
  static void give_way(GivingWay& giving, const ModelInput& input, std::unique_ptr<MovablePoints> points,
                       const DeformerRoom& room, const geometry::Aabb& prepared_box_mm,
                       PrepareReport& report) {
    giving.begin(input, std::move(points), room.journal_points, prepared_box_mm);
    report.bytes += giving.deformer()->bytes();
    report.notes.push_back(
        fmt::format("deformation: up to {} points a frame, {} spare ones, {} changes undone", kMaxMovedPoints,
                    room.spare_points, room.journal_points));
  }

 private:
  [[nodiscard]] Deformer* deformer_of(std::size_t model) const noexcept {
    return model < this->models_.size() ? this->models_[model].giving.deformer() : nullptr;
  }
  template <class Change>
  void put_back(std::size_t model, Change&& change) noexcept {
    this->models_[model].put_back(this->models_.counters(), std::forward<Change>(change));
  }
};

}  // namespace palpate::render
