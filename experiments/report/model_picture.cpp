#include "experiments/report/model_picture.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "toolkit/core/percentiles.h"
#include "toolkit/search/knn.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::experiments {
namespace {

constexpr int kOneThread = 1;  // a sample takes milliseconds

/// Where the viewer stands: above, and to the front left.
constexpr double kElevationDeg = 42.0, kAzimuthDeg = -60.0;
constexpr double kRadPerDeg = 0.017453292519943295769;  // pi / 180
constexpr double kMargin = 0.04;                        // of the picture, on every side

/// A disc reaches as far as the eighth neighbour of most points, so that no gap is seen between them.
constexpr double kDiscPerEighth = 0.8;
constexpr double kLeastDisc = 0.8, kMostDisc = 14.0;  // pixels
constexpr double kSteepest = 0.25;                    // of a normal towards the viewer: a disc is no spike

constexpr double kDarkest = 70.0, kBrightest = 236.0;  // leaves white to the paper, and black to the path

std::uint8_t shade(const Vec3& normal, const ModelView& view) {
  const Vec3 light = (view.towards() + 0.7 * view.up() - 0.9 * view.right()).normalized();
  const double lit = std::max(0.0, normal.dot(light));
  return static_cast<std::uint8_t>(std::lround(kDarkest + (kBrightest - kDarkest) * lit));
}

/// Fills one disc on its plane; what is nearer stays.
void splat(const ModelView& view, const Vec3& at_mm, const Vec3& normal, double radius, GreyImage& image,
           std::vector<float>& nearest) {
  const ModelView::Seen centre = view.seen(at_mm);
  const double facing = std::max(normal.dot(view.towards()), kSteepest);
  // Depth over the picture: the plane's slope to the right and upward.
  const double right = -normal.dot(view.right()) / facing / view.pixels_per_mm();
  const double up = -normal.dot(view.up()) / facing / view.pixels_per_mm();
  const std::uint8_t grey = shade(normal, view);
  const auto from = [](double c, double r) { return static_cast<int>(std::ceil(c - r)); };
  for (int y = std::max(0, from(centre.y, radius)); y < image.height && y <= centre.y + radius; ++y)
    for (int x = std::max(0, from(centre.x, radius)); x < image.width && x <= centre.x + radius; ++x) {
      const double dx = x - centre.x, dy = y - centre.y;
      if (dx * dx + dy * dy > radius * radius) continue;
      const auto depth = static_cast<float>(centre.near_mm + right * dx - up * dy);
      const std::size_t i =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
      if (depth <= nearest[i]) continue;
      nearest[i] = depth;
      image.pixels[i] = grey;
    }
}

void draw_model(const cloud::Cloud& points, const ModelView& view, GreyImage& image,
                std::vector<float>& nearest) {
  if (points.empty()) return;
  const search::NeighbourTable table = search::exact_knn(points, kOneThread);
  std::vector<surface::OrientedPoint> planes = surface::surface_points(points);
  surface::fit_planes(planes, table.of, kOneThread);
  std::vector<Vec3> normals = surface::normals_of(planes);
  std::vector<double> reach;
  for (std::size_t i = 0; i < points.size(); ++i)
    reach.push_back((points.local_mm(table.of[i].back()) - points.local_mm(i)).norm());
  const double radius = std::clamp(kDiscPerEighth * upper_median(std::move(reach)) * view.pixels_per_mm(),
                                   kLeastDisc, kMostDisc);
  for (std::size_t i = 0; i < points.size(); ++i) {
    Vec3& normal = normals[i];
    if (normal == Vec3::Zero()) normal = view.towards();
    if (normal.dot(view.towards()) < 0.0) normal = -normal;
    splat(view, points.point_mm(i), normal, radius, image, nearest);
  }
}

}  // namespace

ModelView::ModelView(const geometry::Aabb& box, int width, int height) : width_(width), height_(height) {
  const double elevation = kElevationDeg * kRadPerDeg, azimuth = kAzimuthDeg * kRadPerDeg;
  towards_ = {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
              std::sin(elevation)};
  right_ = Vec3::UnitZ().cross(towards_).normalized();
  up_ = towards_.cross(right_);
  centre_mm_ = box.centre_mm();
  const Vec3 half = 0.5 * box.extent_mm();
  const double wide = half.dot(right_.cwiseAbs()), high = half.dot(up_.cwiseAbs());
  const double room = 0.5 - kMargin;
  scale_ = std::min(wide > 0.0 ? room * width / wide : std::numeric_limits<double>::infinity(),
                    high > 0.0 ? room * height / high : std::numeric_limits<double>::infinity());
  if (!std::isfinite(scale_)) scale_ = 1.0;
}

ModelView::Seen ModelView::seen(const Vec3& world_mm) const {
  const Vec3 d = world_mm - centre_mm_;
  return {0.5 * width_ + scale_ * d.dot(right_), 0.5 * height_ - scale_ * d.dot(up_), d.dot(towards_)};
}

GreyImage draw_models(const std::vector<ModelSample>& models, const ModelView& view) {
  constexpr std::uint8_t kPaper = 255;
  GreyImage image{view.width(), view.height(), {}};
  const auto pixels = static_cast<std::size_t>(view.width()) * static_cast<std::size_t>(view.height());
  image.pixels.assign(pixels, kPaper);
  std::vector<float> nearest(pixels, -std::numeric_limits<float>::infinity());
  for (const ModelSample& model : models) draw_model(model.points, view, image, nearest);
  return image;
}

}  // namespace palpate::experiments
