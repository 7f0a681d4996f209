// Renderers whose models can be changed while they are felt.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include <palpate/cloud.h>
#include <palpate/result.h>
#include "toolkit/deformation/deformer.h"

namespace palpate::render {

/// Called between frames, by the thread that runs them. `model` is an index into the scene's models.
class Editable {
 public:
  virtual ~Editable() = default;
  /// Takes back what one touch changed, the last one first. False where there is nothing to take back.
  virtual bool undo(std::size_t model) noexcept = 0;
  /// The model as it was prepared. O(n).
  virtual void restore(std::size_t model) noexcept = 0;
  /// The model's points as they are now. An Error where the model does not give way.
  [[nodiscard]] virtual Result<cloud::Cloud> edited(std::size_t model) const = 0;
  /// Where a point of the cloud is now, relative to the cloud's origin; nothing where the model does not give
  /// way. O(1).
  [[nodiscard]] virtual std::optional<Vec3> point_position_mm(std::size_t model,
                                                              std::uint32_t point) const noexcept = 0;
  [[nodiscard]] virtual DeformCounters deform_counters(std::size_t model) const noexcept = 0;
};

}  // namespace palpate::render
