// A local Delaunay surface whose points move. The triangles stay, but a stretched edge gets a point; the tree
// over the triangles follows. A journal keeps former places stroke by stroke, so that strokes can be undone.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/local_delaunay/deformable_mesh.h"
#include "toolkit/local_delaunay/mesh_descent.h"
#include "toolkit/render/surface_field.h"

namespace palpate::deformation {

class UndoJournal;

/// Points one call may infer; stretched links beyond it are repaired when they are moved again.
inline constexpr std::size_t kMaxInferredPoints = 8;

struct DeformCounters {
  std::uint64_t moved = 0;         ///< points moved
  std::uint64_t inferred = 0;      ///< points added where the surface was stretched
  std::uint64_t refused = 0;       ///< moves to no finite place: the point stayed
  std::uint64_t not_inferred = 0;  ///< stretched links left for want of spare points
  std::uint64_t forgotten = 0;     ///< strokes that can no more be undone
};

struct MovedPoint {
  std::uint32_t place;
  Vec3 from_mm, to_mm;
};

/// Receives every point that goes from one place to another, as soon as it has gone.
class MoveWatcher {
 public:
  virtual void point_moved(std::uint32_t place, const Vec3& from, const Vec3& to) noexcept = 0;

 protected:
  ~MoveWatcher() = default;
};

/// A watcher that calls callback(place, from, to).
template <class Callback>
class CallbackWatcher final : public MoveWatcher {
 public:
  explicit CallbackWatcher(Callback callback) : callback_(callback) {}
  void point_moved(std::uint32_t place, const Vec3& from, const Vec3& to) noexcept override {
    callback_(place, from, to);
  }

 private:
  Callback callback_;
};

/// The state that a deformer changes. Local coordinates, mm. Places below built() are the cloud's points,
/// those from there to used() were inferred since, and go again in the opposite order. Nothing allocates but
/// the constructor and reserve_records(); no other call throws.
class DeformedLocalDelaunay {
 public:
  /// `mesh` is this renderer's own, still with its order(), and gets room for the spare points; `tree`
  /// becomes the tree over it; `surface` is what it is made of. All outlive this. Allocates.
  DeformedLocalDelaunay(local_delaunay::LocalDelaunayMesh& mesh, local_delaunay::BlockBvh& tree,
                        render::SurfaceField& surface, std::size_t spare_points, int threads);
  DeformedLocalDelaunay(const DeformedLocalDelaunay&) = delete;
  DeformedLocalDelaunay& operator=(const DeformedLocalDelaunay&) = delete;
  ~DeformedLocalDelaunay() = default;

  [[nodiscard]] std::uint32_t built() const noexcept { return stars_.built(); }
  [[nodiscard]] std::uint32_t used() const noexcept { return stars_.used(); }
  /// Places there can be.
  [[nodiscard]] std::uint32_t most() const noexcept { return stars_.most(); }
  [[nodiscard]] const Vec3& origin_mm() const noexcept { return stars_.mesh().origin_mm(); }
  [[nodiscard]] std::uint32_t place_of(std::uint32_t point) const noexcept { return place_of_[point]; }
  [[nodiscard]] Vec3 at(std::uint32_t place) const noexcept { return stars_.mesh().at(place); }
  /// Where the surface there was when it was built.
  [[nodiscard]] Vec3 initial_position(std::uint32_t place) const noexcept {
    return first_[place].at.cast<double>();
  }
  /// The distance of points there then: to the farthest of those around, mm.
  [[nodiscard]] double initial_resolution_mm(std::uint32_t place) const noexcept {
    return static_cast<double>(first_[place].longest_mm);
  }
  /// The surface's normal there, as long as the area that is the point's.
  [[nodiscard]] Vec3 area_normal(std::uint32_t place) const noexcept {
    return local_delaunay::area_normal_around(stars_.mesh(), place);
  }
  [[nodiscard]] std::span<const std::uint32_t> links(std::uint32_t place) const noexcept {
    const local_delaunay::Ring ring = stars_.mesh().ring(place);
    return {ring.of, ring.size};  // of points that move: in the mesh, not in `ring`
  }
  /// A place itself where it is below `below`, or one that it was inferred from.
  [[nodiscard]] std::uint32_t standing(std::uint32_t place, std::uint32_t below) const noexcept {
    while (place >= below) place = stars_.parents(place)[0];
    return place;
  }

  void set(std::uint32_t place, const Vec3f& to) noexcept { stars_.set(place, to); }
  /// Updates what depends on the moved points: boxes, and new points where the surface is stretched.
  void update_dependents(std::span<const MovedPoint> moved, UndoJournal& journal, DeformCounters& counters,
                         MoveWatcher& watcher) noexcept;

  /// Room for so many records.
  void reserve_records(std::size_t count) { records_.resize(count); }
  /// Keeps in a record what a place is like.
  void keep(std::size_t record, std::uint32_t place) noexcept { records_[record] = at(place).cast<float>(); }
  /// The place is as the record says.
  void put_back(std::size_t record, std::uint32_t place) noexcept { set(place, records_[record]); }
  /// The same, as it was built; no point is inferred any more.
  void restore_initial(std::uint32_t place) noexcept {
    if (first_[place].at != Vec3f(at(place).cast<float>())) set(place, first_[place].at);
  }
  /// The last inferred point goes.
  void remove_last(MoveWatcher& watcher) noexcept;
  /// Everything is back that was to go back.
  void finish_restoring() noexcept { stars_.refit_all(); }

  [[nodiscard]] std::size_t bytes() const noexcept;
  /// Bytes that bytes() will give, and by which mesh and tree will grow.
  [[nodiscard]] static std::size_t bytes_for(std::size_t points, std::size_t spare_points,
                                             std::size_t records) noexcept;

 private:
  /// The surface around a place as it was built.
  struct First {
    Vec3f at = Vec3f::Zero();
    float mean_mm = 0.0f, longest_mm = 0.0f;  ///< of the edges there
  };
  [[nodiscard]] bool stretched(std::uint32_t a, std::uint32_t b) const noexcept;
  bool infer_between(std::uint32_t a, std::uint32_t b, UndoJournal& journal, MoveWatcher& watcher) noexcept;

  local_delaunay::DeformableMesh stars_;
  render::SurfaceField* surface_;
  LargePageVector<std::uint32_t> place_of_;
  LargePageVector<First> first_;
  std::vector<Vec3f> records_;
};

/// Belongs to one deformer. Only the constructor allocates.
class UndoJournal {
 public:
  struct Entry {
    std::uint32_t place;
    bool existed;
  };

  /// Room for `entries`; where they are used up the oldest strokes are forgotten. The records are the
  /// points'.
  UndoJournal(DeformedLocalDelaunay& points, std::size_t entries) : points_(&points), entries_(entries) {
    points.reserve_records(entries);
    recorded_.resize(points.most());
  }

  /// Changes from now on are undone together.
  void begin_stroke() noexcept {
    ++stroke_number_;
    // An empty stroke is used again.
    if (next_stroke_ > first_stroke_ && strokes_[(next_stroke_ - 1) % kMaxStrokes] == next_entry_) return;
    if (next_stroke_ - first_stroke_ == kMaxStrokes) forget_oldest();
    strokes_[next_stroke_++ % kMaxStrokes] = next_entry_;
  }
  /// Before a place is changed, or when one has come that did not exist: what it was like before the stroke,
  /// once.
  void remember(std::uint32_t place, bool existed) noexcept {
    if (recorded_[place] == stroke_number_) return;
    recorded_[place] = stroke_number_;
    if (entries_.empty()) return;
    // The ring is full: the strokes whose first entries would be written over are forgotten.
    while (first_stroke_ < next_stroke_ &&
           next_entry_ - strokes_[first_stroke_ % kMaxStrokes] >= entries_.size())
      forget_oldest();
    const std::size_t at = next_entry_++ % entries_.size();
    entries_[at] = {place, existed};
    if (existed) points_->keep(at, place);
  }
  /// restore(entry, its record) for the last stroke that is remembered, the last change first. False where
  /// there is none.
  template <class Restore>
  bool undo_last_stroke(Restore&& restore) noexcept {
    if (first_stroke_ == next_stroke_) return false;
    // The stroke that is open may be empty: then the one before is meant.
    if (strokes_[(next_stroke_ - 1) % kMaxStrokes] == next_entry_) {
      if (next_stroke_ - 1 == first_stroke_) return false;
      --next_stroke_;
    }
    const std::size_t begin = strokes_[(next_stroke_ - 1) % kMaxStrokes];
    while (next_entry_ > begin) {
      const std::size_t at = --next_entry_ % entries_.size();
      restore(entries_[at], at);
    }
    --next_stroke_;
    begin_stroke();
    return true;
  }
  void forget_all() noexcept {
    first_stroke_ = next_stroke_ = 0;
    next_entry_ = 0;
    begin_stroke();
  }
  [[nodiscard]] std::uint64_t forgotten() const noexcept { return forgotten_; }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return entries_.capacity() * sizeof(Entry) + recorded_.capacity() * sizeof(std::uint64_t);
  }
  [[nodiscard]] static std::size_t bytes_for(std::size_t places, std::size_t entries) noexcept {
    return entries * sizeof(Entry) + places * sizeof(std::uint64_t);
  }

 private:
  static constexpr std::size_t kMaxStrokes = 64;
  void forget_oldest() noexcept {
    ++first_stroke_;
    ++forgotten_;
  }

  DeformedLocalDelaunay* points_;
  std::vector<Entry> entries_;                      ///< a ring
  std::size_t next_entry_ = 0;                      ///< ever rising
  std::array<std::size_t, kMaxStrokes> strokes_{};  ///< a ring: the first entry of each
  std::size_t first_stroke_ = 0, next_stroke_ = 0;
  std::vector<std::uint64_t> recorded_;  ///< by place: the stroke that recorded it last
  std::uint64_t stroke_number_ = 0;
  std::uint64_t forgotten_ = 0;
};

}  // namespace palpate::deformation
