// Geometric deformation (section 3.3.2.2): the points themselves move, and with them the partition, the links
// and the planes, within the frame's budget. Dents pressed by the probe, batches computed elsewhere, undo,
// new points where the surface is stretched.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/points/point_model.h"
#include "toolkit/render/move_queue.h"

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

/// A dent bears where it is so many times as deep as its radius: its walls, 1.54 times as steep at their
/// steepest by the profile (1 - r^2)^2, then stand at 57 degrees. Steeper ones fold.
inline constexpr double kDeepestPerRadius = 1.0;
/// And it is at least so many local resolutions wide: of fewer points it would be a spike, not a surface.
inline constexpr double kNarrowestResolutions = 1.0;

/// Changes one prepared model. Belongs to the thread that runs the frames, and is called between them: what a
/// frame has collided with stays where it is until its force is answered. All calls but the constructor,
/// edited() and reset() are noexcept, allocate nothing and are bounded by the numbers above.
class Deformer {
 public:
  struct Options {
    std::size_t spare_points = 0;    ///< for inferred ones; the model must have been built with as many
    std::size_t journal_points = 0;  ///< changes that can be undone; older strokes are forgotten
  };

  /// `model` was built with PointModelOptions::moving, `surface` is what it is made of; both outlive this.
  /// Copies the points: 48 bytes each for reset(), 60 for each journal entry.
  Deformer(PointModel& model, SurfaceField& surface, const Options& options);

  /// What is changed from now on is undone together.
  void begin_stroke() noexcept;
  /// Presses the surface at `place` by `by_mm` against `outward`, less and less out to `radius_mm` along the
  /// links, and infers points where links were stretched so far that boxes no longer touch. No deeper in all
  /// than `deepest_per_radius` times the radius. Returns the number of points moved.
  std::size_t press(std::uint32_t place, const Vec3& outward, double by_mm, double radius_mm,
                    double deepest_per_radius = std::numeric_limits<double>::infinity()) noexcept;
  /// How far the surface at a place has been moved since it was built, in all.
  [[nodiscard]] double sunk_mm(std::uint32_t place) const noexcept;
  /// The local resolution there when it was built: the distance to the farthest of its neighbours.
  [[nodiscard]] double first_resolution_mm(std::uint32_t place) const noexcept;
  /// Moves the batch's points, then their planes follow. Points that do not exist are left out.
  std::size_t apply(const MoveBatch& batch) noexcept;
  /// Takes back the last stroke that is remembered. False where there is none. Work: the stroke's points.
  /// changed(place, from, to) is called for every point that goes back, mm; the model is whole again, and its
  /// inferred points gone, when the call returns.
  template <class Changed>
  bool undo(Changed&& changed) noexcept {
    std::size_t begin = 0;
    if (!find_last_stroke(begin)) return false;
    while (next_entry_ > begin) {
      const Entry& entry = journal_[--next_entry_ % journal_.size()];
      const Vec3 from = model_->points[entry.place].at();
      if (restore(entry)) changed(entry.place, from, model_->points[entry.place].at());
    }
    --next_stroke_;
    begin_stroke();
    return true;
  }
  /// Everything as it was built; changed() as above. O(n).
  template <class Changed>
  void reset(Changed&& changed) noexcept {
    forget_inferred();
    for (std::uint32_t place = 0; place < built_; ++place) {
      const Vec3 from = model_->points[place].at(), to = first_points_[place].at();
      if (put_back(place, first_points_[place], first_links_[place]) && from != to) changed(place, from, to);
    }
    first_stroke_ = next_stroke_ = 0;
    next_entry_ = 0;
    begin_stroke();
  }
  bool undo() noexcept {
    return undo([](std::uint32_t, const Vec3&, const Vec3&) {});
  }
  void reset() noexcept {
    reset([](std::uint32_t, const Vec3&, const Vec3&) {});
  }
  /// Of a place whose inferred point may be gone: the place itself, or one of the surface that it was
  /// inferred in.
  [[nodiscard]] std::uint32_t standing(std::uint32_t place) const noexcept {
    return built_near(place, used_);
  }

  /// The points that the last call of press() or apply() moved, and where each was before.
  struct Moved {
    std::uint32_t place;
    Vec3 from_mm, to_mm;
  };
  [[nodiscard]] std::span<const Moved> last_moved() const noexcept { return {moved_.data(), moved_count_}; }
  [[nodiscard]] const DeformCounters& counters() const noexcept { return counters_; }
  [[nodiscard]] std::size_t points() const noexcept { return used_; }
  [[nodiscard]] std::size_t bytes() const noexcept;
  /// What bytes() will be for a model of so many points.
  [[nodiscard]] static std::size_t bytes_for(std::size_t points, const Options& options) noexcept;

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

  /// The place itself where it is below a number, or one that it was inferred from.
  [[nodiscard]] std::uint32_t built_near(std::uint32_t place, std::size_t below) const noexcept;
  bool move(std::uint32_t place, const Vec3& to_mm) noexcept;
  void remember(std::uint32_t place, bool existed) noexcept;
  void forget_oldest() noexcept;
  void settle() noexcept;
  void mend_stretched() noexcept;
  bool infer_between(std::uint32_t a, std::uint32_t b) noexcept;
  void link_new(std::uint32_t place, std::uint32_t a, std::uint32_t b) noexcept;
  /// The stroke that undo() takes back becomes the last one, `begin` its first entry; false where there is
  /// none.
  bool find_last_stroke(std::size_t& begin) noexcept;
  bool restore(const Entry& entry) noexcept;
  bool put_back(std::uint32_t place, const StoredPoint& point,
                const neighbourhood::Neighbours& links) noexcept;
  void remove_last() noexcept;
  void forget_inferred() noexcept;
  [[nodiscard]] bool apart(std::uint32_t a, std::uint32_t b) const noexcept;
  [[nodiscard]] std::size_t collect(std::uint32_t place, double radius_mm) noexcept;

  PointModel* model_;
  SurfaceField* surface_;
  std::size_t built_;  ///< points at the start
  std::size_t used_;   ///< points now
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
