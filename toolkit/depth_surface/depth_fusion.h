// Depth images fused over time into surfaces.
//
// Each pixel keeps an inverse depth and its variance, of which a plane in space is linear over the raster and
// the noise of structured light the same everywhere. An image updates them by a scalar Kalman filter after
// the common motion of the pixels around was added; what disagrees was replaced by something else. Averages
// over pairs of pixels opposite to each other smooth the result within each sheet: they keep planes exactly,
// up to a sheet's edge, where pairs end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <palpate/depth_stream.h>
#include "toolkit/depth_surface/depth_sheets.h"
#include "toolkit/render/depth_camera.h"

namespace palpate::depth_surface {

/// Time that a surface stays once something nearer hides it, s: a hand that passes takes a second.
inline constexpr double kHiddenSeconds = 2.0;
/// The same for pixels without measurement: the shadow of a moving object must not keep its ghost.
inline constexpr double kBlindSeconds = 0.2;
/// Fastest surface that is followed and that may meet a resting HIP: a thrown object's 2 m/s.
inline constexpr double kFastestMmPerS = 2000.0;
/// Least weight of a new measurement, so that a motion below the noise lags at most 7 images: (1 - g) / g.
inline constexpr double kLeastGain = 1.0 / 8.0;

/// For one thread. Allocates in construction only.
class DepthFusion {
 public:
  explicit DepthFusion(const stream::DepthCamera& camera);

  void forget() noexcept;
  /// Begins an image (of the camera's size, taken): its pose, noise and motion since the last.
  void begin(const stream::DepthFrame& image, DepthSheets& sheets) noexcept;
  /// Writes the image's surfaces in a window. Windows are independent of each other.
  void update(const stream::DepthFrame& image, const render::PixelWindow& window,
              DepthSheets& sheets) noexcept;
  /// Ends the image, whose whole window was updated.
  void finish() noexcept { std::swap(before_, now_); }

  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  using Raster = std::vector<float>;
  struct State {
    Raster w, variance, age_s, shown, hidden, hidden_age_s;
    std::vector<std::uint8_t> right, below;  ///< 1: of one sheet with that neighbour
    [[nodiscard]] std::array<Raster*, 6> rasters() noexcept {
      return {&w, &variance, &age_s, &shown, &hidden, &hidden_age_s};
    }
    [[nodiscard]] std::array<const Raster*, 6> rasters() const noexcept {
      return {&w, &variance, &age_s, &shown, &hidden, &hidden_age_s};
    }
  };

  void invert(const stream::DepthFrame& image, const render::PixelWindow& window) noexcept;
  [[nodiscard]] float inverse_at(const stream::DepthFrame& image, int u, int v) const noexcept;
  void estimate_noise(const stream::DepthFrame& image) noexcept;
  void choose_radius(double w) noexcept;
  void warp(const render::PixelWindow& window) noexcept;
  void splat(std::size_t from, std::size_t to, float w, float shown) noexcept;
  void compare(const render::PixelWindow& window) noexcept;
  void fuse(const render::PixelWindow& window) noexcept;
  void fuse_pixel(std::size_t i, float shift, bool together, bool still) noexcept;
  void fill(const render::PixelWindow& window) noexcept;
  void link(const render::PixelWindow& window) noexcept;
  void smooth(const render::PixelWindow& window) noexcept;
  void write(const render::PixelWindow& window, DepthSheets& sheets) const noexcept;

  [[nodiscard]] float variance_of(float w) const noexcept {
    const float sigma = noise_near_ * w * w + noise_far_;
    return sigma * sigma;
  }

  stream::DepthCamera camera_;
  DepthSheets grid_;        ///< of the same size, for its arithmetic; holds no surface
  Raster lens_u_, lens_v_;  ///< where in the image a pixel of the raster is; empty: no lens
  State before_, now_, warped_;
  const State* prior_ = nullptr;  ///< before_, or warped_ if the camera moved
  Raster measured_, half_, rate_;
  Raster change_, counted_;                       ///< of one row
  Raster row_change_, row_square_, row_counted_;  ///< sums over a row's neighbours
  std::vector<float> samples_;

  geometry::RigidTransform pose_;
  Mat3 turn_ = Mat3::Identity();  ///< new camera from the last one
  Vec3 shift_mm_ = Vec3::Zero();
  bool any_ = false, moved_ = false;
  double captured_s_ = 0.0;
  float dt_s_ = 0.0F;
  float noise_near_ = 0.0F, noise_far_ = 0.0F;  ///< of w: noise_near w^2 + noise_far
  float steep_ = 0.0F;                          ///< kSteepestSlope's step between pixels, over w
  int radius_ = 0;
};

}  // namespace palpate::depth_surface
