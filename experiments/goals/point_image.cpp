#include "experiments/goals/point_image.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

constexpr std::uint64_t kOrderSeed = 20'090'414;
/// The camera looks down at 30 degrees from this many radii away and sees the whole model.
constexpr float kSine = 0.5f, kCosine = 0.8660254f, kAwayRadii = 4.0f;
/// Pixels of a radius at a distance of one radius.
constexpr float kFocal = 1200.0f;
constexpr std::uint8_t kPaper = 255;
/// Greys of near (dark) and far (light) points.
constexpr float kDarkestPoint = 30.0f, kLightestPoint = 200.0f;
constexpr int kCross = 12;

}  // namespace

PointDrawer::PointDrawer(const cloud::Cloud& cloud) : origin_mm_(cloud.origin_mm) {
  points_.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i)
    points_.push_back({cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]});
  Random random(kOrderSeed);
  for (std::size_t i = points_.size(); i > 1; --i)
    std::swap(points_[i - 1], points_[static_cast<std::size_t>(random.below(i))]);
  const double radius = 0.5 * cloud.box_mm().extent_mm().norm();
  radius_mm_ = radius > 0.0 ? static_cast<float>(radius) : 1.0f;
  constexpr std::size_t kPixels = std::size_t{kImageWidth} * kImageHeight;
  image_.grey.assign(kPixels, kPaper);
  image_.depth_mm.assign(kPixels, std::numeric_limits<float>::infinity());
}

void PointDrawer::begin(double turn_rad) {
  right_x_ = static_cast<float>(std::cos(turn_rad));
  right_y_ = static_cast<float>(std::sin(turn_rad));
  std::fill(image_.grey.begin(), image_.grey.end(), kPaper);
  std::fill(image_.depth_mm.begin(), image_.depth_mm.end(), std::numeric_limits<float>::infinity());
  next_ = 0;
}

PointDrawer::Seen PointDrawer::see(float x, float y, float z) const noexcept {
  const float across = right_x_ * x + right_y_ * y, along = right_x_ * y - right_y_ * x;
  const float up = kCosine * z - kSine * -along, away = kCosine * along - kSine * z + kAwayRadii * radius_mm_;
  if (!(away > 0.0f)) return {};
  const float scale = kFocal / away;
  const float column = 0.5f * kImageWidth + scale * across, row = 0.5f * kImageHeight - scale * up;
  if (!(column >= 0.0f && column < kImageWidth && row >= 0.0f && row < kImageHeight)) return {};
  return {static_cast<int>(column), static_cast<int>(row), away};
}

std::size_t PointDrawer::draw(std::size_t count) noexcept {
  const std::size_t end = std::min(points_.size(), next_ + count);
  const float nearest = (kAwayRadii - 1.0f) * radius_mm_, range = 2.0f * radius_mm_;
  for (; next_ < end; ++next_) {
    const Point& point = points_[next_];
    const Seen seen = see(point.x, point.y, point.z);
    if (seen.column < 0) continue;
    const auto pixel =
        static_cast<std::size_t>(seen.row) * kImageWidth + static_cast<std::size_t>(seen.column);
    if (!(seen.depth_mm < image_.depth_mm[pixel])) continue;
    image_.depth_mm[pixel] = seen.depth_mm;
    const float share = std::clamp((seen.depth_mm - nearest) / range, 0.0f, 1.0f);
    image_.grey[pixel] = static_cast<std::uint8_t>(kDarkestPoint + share * (kLightestPoint - kDarkestPoint));
  }
  return points_.size() - next_;
}

void PointDrawer::mark(const Vec3& at_mm) noexcept {
  const Vec3 at = at_mm - origin_mm_;
  if (!is_finite(at)) return;
  const Seen seen = see(static_cast<float>(at.x()), static_cast<float>(at.y()), static_cast<float>(at.z()));
  if (seen.column < 0) return;
  for (int i = -kCross; i <= kCross; ++i) {
    const int column = std::clamp(seen.column + i, 0, kImageWidth - 1);
    const int row = std::clamp(seen.row + i, 0, kImageHeight - 1);
    image_.grey[static_cast<std::size_t>(seen.row) * kImageWidth + static_cast<std::size_t>(column)] = 0;
    image_.grey[static_cast<std::size_t>(row) * kImageWidth + static_cast<std::size_t>(seen.column)] = 0;
  }
}

}  // namespace palpate::experiments
