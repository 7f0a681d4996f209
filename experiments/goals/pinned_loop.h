// A servo loop and a drawing thread on one core. No core is spare. Measures tick lateness, step times and
// pictures; these come from a software point renderer with depth.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>

namespace palpate::experiments {

inline constexpr int kImageWidth = 1280, kImageHeight = 720;

struct PointImage {
  std::vector<std::uint8_t> grey;  ///< rows from the top; empty: nothing drawn
  std::vector<float> depth_mm;
};

/// Draws a cloud progressively in random order, so every prefix is an even sample and an early end still
/// shows the whole.
class PointDrawer {
 public:
  /// Copies the points. O(n).
  explicit PointDrawer(const cloud::Cloud& cloud);

  /// Begins a picture with the camera rotated by `turn_rad`.
  void begin(double turn_rad);
  /// Draws the next `count` points; returns the number left.
  std::size_t draw(std::size_t count) noexcept;
  /// Draws a small cross at a model position.
  void mark(const Vec3& at_mm) noexcept;
  [[nodiscard]] const PointImage& image() const noexcept { return image_; }
  [[nodiscard]] std::size_t size() const noexcept { return points_.size(); }

 private:
  struct Point {
    float x, y, z;
  };
  struct Seen {
    int column = -1, row = -1;
    float depth_mm = 0.0f;
  };
  [[nodiscard]] Seen see(float x, float y, float z) const noexcept;

  std::vector<Point> points_;
  PointImage image_;
  Vec3 origin_mm_ = Vec3::Zero();
  float radius_mm_ = 1.0f;
  float right_x_ = 1.0f, right_y_ = 0.0f;  // the camera's, in the xy plane
  std::size_t next_ = 0;
};

struct PinnedOptions {
  double seconds = 10.0;
  bool draw = false;  ///< a second thread on the same core draws the cloud
};

struct PinnedRun {
  int cpu = -1;                             ///< common core of both; -1: pinning was refused
  bool real_time = false;                   ///< the servo had SCHED_FIFO
  std::vector<std::string> not_obtained{};  ///< what the servo was refused, with remedies
  std::vector<std::int64_t> late_ns;        ///< by tick: start after due time
  std::vector<std::int64_t> step_ns;        ///< by tick: the renderer's frame, interruptions included
  std::uint64_t skipped_ticks = 0;          ///< passed before they could begin
  std::uint64_t images = 0, points_drawn = 0;
  double drawn_s = 0.0;  ///< running time of the drawing thread
  PointImage last;       ///< the last picture; empty if none
};

/// Steps the prepared renderer repeatedly along the path at 1 kHz in its own thread. Error: no thread.
/// Allocates before the first tick only.
[[nodiscard]] Result<PinnedRun> run_pinned(render::HapticRenderer& renderer, const trace::ProbePath& path,
                                           const cloud::Cloud& cloud, const PinnedOptions& options);

}  // namespace palpate::experiments
