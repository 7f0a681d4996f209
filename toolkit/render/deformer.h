// Geometric deformation (section 3.3.2.2): the points themselves move, and with them the partition, the links
// and the planes, within the frame's budget. Dents pressed by the probe, batches computed elsewhere, undo,
// new points where the surface is stretched.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/render/move_queue.h"
#include "toolkit/render/point_model.h"

namespace palpate::render {

/// Points one call may move; of a larger dent the nearest to its middle move.
inline constexpr std::size_t kMaxMovedPoints = 128;
/// Points one call may infer; stretched links beyond it are mended when they are moved again.
inline constexpr std::size_t kMaxInferredPoints = 8;

struct DeformCounters {
  std::uint64_t moved = 0;         ///< points moved
  std::uint64_t inferred = 0;      ///< points added where the surface was stretched
  std::uint64_t refused = 0;       ///< moves for which the partition had no room: the point stayed
  std::uint64_t not_inferred = 0;  ///< stretched links left for want of spare points
  std::uint64_t forgotten = 0;     ///< strokes that can no more be undone
};

/// Changes one prepared model. Belongs to the thread that runs the frames, and is called between them: what a
/// frame has collided with stays where it is until its force is answered. All calls but the constructor,
/// edited() and reset() are noexcept, allocate nothing and are bounded by the numbers above.
class Deformer {
 public:
  struct Options {
    std::size_t spare_points = 0;    ///< for inferred ones; the model must have been built with as many
    std::size_t journal_points = 0;  ///< changes that can be undone; older strokes are forgotten
  };

  /// `model` was built with PartitionKind::kMoving and outlives this. Copies its points: 48 bytes each for
  /// reset(), 60 for each journal entry.
  Deformer(PointModel& model, const Options& options);

  /// What is changed from now on is undone together.
  void begin_stroke() noexcept;
  /// Presses the surface at `place` by `by_mm` against `outward`, less and less out to `radius_mm` along the
  /// links, and infers points where links were stretched so far that boxes no longer touch. Returns the
  /// number of points moved.
  std::size_t press(std::uint32_t place, const Vec3& outward, double by_mm, double radius_mm) noexcept;
  /// Moves the batch's points, then their planes follow. Points that do not exist are left out.
  std::size_t apply(const MoveBatch& batch) noexcept;
  /// Takes back the last stroke that is remembered. False where there is none. Work: the stroke's points.
  bool undo() noexcept;
  /// Everything as it was built. O(n).
  void reset() noexcept;

  /// The points that the last call of press() or apply() moved, and where each was before.
  struct Moved {
    std::uint32_t place;
    Vec3 from_mm, to_mm;
  };
  [[nodiscard]] std::span<const Moved> last_moved() const noexcept { return {moved_.data(), moved_count_}; }
  [[nodiscard]] const DeformCounters& counters() const noexcept { return counters_; }
  [[nodiscard]] std::size_t points() const noexcept { return used_; }
  [[nodiscard]] std::size_t bytes() const noexcept;

  /// The cloud as it is now, inferred points behind the others. Model frame.
  [[nodiscard]] Result<cloud::Cloud> edited() const;

 private:
  struct Entry {
    std::uint32_t place;
    bool existed;
    StoredPoint point;
    neighbourhood::Neighbours links;
  };
  struct Stroke {
    std::size_t begin;  ///< entry number, ever rising
  };
  static constexpr std::size_t kMaxStrokes = 64;

  bool move(std::uint32_t place, const Vec3& to_mm) noexcept;
  void remember(std::uint32_t place, bool existed) noexcept;
  void forget_oldest() noexcept;
  void settle() noexcept;
  void mend_stretched() noexcept;
  bool infer_between(std::uint32_t a, std::uint32_t b) noexcept;
  void link_new(std::uint32_t place, std::uint32_t a, std::uint32_t b) noexcept;
  void restore(const Entry& entry) noexcept;
  [[nodiscard]] bool apart(std::uint32_t a, std::uint32_t b) const noexcept;
  [[nodiscard]] std::size_t collect(std::uint32_t place, double radius_mm) noexcept;

  PointModel* model_;
  partition::DynamicGrid* grid_;  ///< the model's
  std::size_t built_;             ///< points at the start
  std::size_t used_;              ///< points now
  LargeVector<StoredPoint> first_points_;
  LargeVector<neighbourhood::Neighbours> first_links_;
  std::vector<Entry> journal_;                 ///< a ring
  std::size_t next_entry_ = 0;                 ///< ever rising
  std::array<Stroke, kMaxStrokes> strokes_{};  ///< a ring
  std::size_t first_stroke_ = 0, next_stroke_ = 0;
  std::vector<std::uint64_t> seen_;      ///< by place: the search that saw it last
  std::vector<std::uint64_t> recorded_;  ///< by place: the stroke that recorded it last, + 1
  std::uint64_t searches_ = 0;
  std::uint64_t stroke_number_ = 0;
  std::array<std::uint32_t, kMaxMovedPoints> found_{};
  std::array<Moved, kMaxBatch> moved_{};
  std::size_t moved_count_ = 0;
  DeformCounters counters_;
};

}  // namespace palpate::render
