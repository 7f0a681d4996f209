#include "experiments/window/scene_view.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "toolkit/render/prepare.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::experiments {
namespace {

/// Sine of 15 degrees: flatter views count as edge-on.
constexpr double kSeenOnEdge = 0.26;

/// Longest walk between neighbours towards a place: a cloud of four million points is two thousand across.
constexpr int kLongestWalk = 4'000;
/// A walk that ends more boxes away than this is stuck; then all points are searched.
constexpr double kStuckBoxes = 4.0;
constexpr int kStarThreads = 1;  // beside a servo
/// Cell width in resolutions (thesis, table 7), here of the median resolution, as `cloud` sizes cells on
/// uneven points.
constexpr double kCellResolutions = 5.0;
/// Resolutions sampled for the median.
constexpr std::size_t kResolutionsLookedAt = 10'000;
/// Most cells drawn, the first of a longer path.
constexpr int kMostCells = 200;

double distance_sq(const cloud::Cloud& cloud, std::uint32_t point, const Vec3& local_mm) {
  return (cloud.local_mm(point) - local_mm).squaredNorm();
}

/// Median distance to the farthest neighbour, over a sample of the points.
double usual_resolution_mm(const cloud::Cloud& cloud, const search::NeighbourTable& neighbours) {
  std::vector<double> sq;
  const std::size_t every = std::max<std::size_t>(1, cloud.size() / kResolutionsLookedAt);
  for (std::size_t i = 0; i < cloud.size(); i += every) {
    double most = 0.0;
    for (const std::uint32_t other : neighbours.of[i])
      most = std::max(most, distance_sq(cloud, other, cloud.local_mm(i)));
    if (most > 0.0) sq.push_back(most);
  }
  if (sq.empty()) return 1.0;  // all points coincide: any cell holds them
  const auto middle = sq.begin() + static_cast<std::ptrdiff_t>(sq.size() / 2);
  std::nth_element(sq.begin(), middle, sq.end());
  return std::sqrt(*middle);
}

std::uint32_t nearest_of_all(const cloud::Cloud& cloud, const Vec3& local_mm) {
  std::uint32_t best = 0;
  double least = distance_sq(cloud, 0, local_mm);
  for (std::uint32_t i = 1; i < cloud.size(); ++i) {
    const double now = distance_sq(cloud, i, local_mm);
    if (now >= least) continue;
    least = now;
    best = i;
  }
  return best;
}

}  // namespace

void SceneView::show(std::shared_ptr<const ShownScene> scene) {
  // Pending results belong to the previous scene.
  colours_ = {};
  surroundings_ = {};
  stars_ = {};
  grid_ = {};
  models_.clear();
  splats_->clear();
  streamed_ = false;
  scene_ = std::move(scene);
  if (!scene_) return;
  box_mm_ = render::box_of(scene_->models);
  ColourScale scale;
  for (const render::ModelInput& input : scene_->models) {
    Model model;
    model.order = even_order(input.cloud->size());
    model.world_from_model = input.world_from_model;
    const std::vector<float> places = places_in_order(*input.cloud, model.order);
    const std::vector<Rgba> colours = colours_in_order(input, model.order, ColourBy::kPlain, scale);
    splats_->place(splats_->add(places, colours, input.cloud->origin_mm), model.world_from_model);
    if (input.surface.dent.any() || input.moves) {
      model.index_of.resize(model.order.size());
      for (std::uint32_t i = 0; i < model.order.size(); ++i) model.index_of[model.order[i]] = i;
    }
    models_.push_back(std::move(model));
  }
  surroundings_ = std::async(std::launch::async, [shown = scene_] {
    std::vector<std::shared_ptr<const Surroundings>> found;
    for (const render::ModelInput& input : shown->models)
      found.push_back(std::make_shared<const Surroundings>(find_surroundings(*input.cloud)));
    return found;
  });
  const ColourBy wanted = std::exchange(colour_, ColourBy::kPlain);
  scale_ = {};
  colour(wanted);
}

void SceneView::colour(ColourBy by) {
  if (by == colour_ || !scene_) {
    colour_ = by;
    return;
  }
  colour_ = by;
  std::vector<std::vector<std::uint32_t>> orders;
  for (const Model& model : models_) orders.push_back(model.order);
  colours_ = std::async(std::launch::async, [shown = scene_, by, orders = std::move(orders)] {
    Coloured coloured;
    for (std::size_t i = 0; i < orders.size(); ++i)
      coloured.of.push_back(colours_in_order(shown->models[i], orders[i], by, coloured.scale));
    return coloured;
  });
}

const char* SceneView::awaited() const noexcept {
  if (colours_.valid()) return "colours are being computed";
  if (surroundings_.valid()) return "normals are being found";
  if (grid_.valid()) return "cells are being found";
  return stars_.valid() ? "facets are being found" : "";
}

void SceneView::show_image(const ShownImage& image) {
  if (models_.empty()) return;
  constexpr std::size_t kAPlace = 3;
  streamed_ = true;
  image_colour_.resize(image.places.size() / kAPlace, kPlainColour);
  splats_->replace(0, image.places, image_colour_, Vec3::Zero());
  splats_->place(0, image.world_from_camera);
  models_.front().world_from_model = image.world_from_camera;
}

void SceneView::take_surroundings() {
  const std::vector<std::shared_ptr<const Surroundings>> found = surroundings_.get();
  if (streamed_) return;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    models_[i].known = found[i];
    std::vector<PackedNormal> normals;
    normals.reserve(models_[i].order.size());
    for (const std::uint32_t point : models_[i].order) normals.push_back(found[i]->normals[point]);
    splats_->set_normals(i, normals);
  }
}

void SceneView::update(const WatchedTick* now) {
  if (ready(colours_)) {
    const Coloured coloured = colours_.get();
    scale_ = coloured.scale;
    for (std::size_t i = streamed_ ? models_.size() : 0; i < models_.size(); ++i)
      splats_->recolour(i, coloured.of[i]);
  }
  if (ready(surroundings_)) take_surroundings();
  if (ready(stars_)) {
    Model& model = models_[stars_of_];
    model.stars = stars_.get();
    model.star_place.assign(model.order.size(), local_delaunay::kNoPlace);
    const std::vector<std::uint32_t>& order = model.stars->order();
    for (std::uint32_t place = 0; place < order.size(); ++place) model.star_place[order[place]] = place;
  }
  if (ready(grid_)) models_[grid_of_].grid = grid_.get();
  if (now == nullptr || now->ticks == 0 || !scene_) return;
  std::size_t moving = 0;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    if (!scene_->models[i].motion || moving == kMostShownMotions) continue;
    models_[i].world_from_model = now->world_from_model[moving++];
    splats_->place(i, models_[i].world_from_model);
  }
}

void SceneView::follow_dents(WindowFeed& feed, const WatchedTick& now) {
  if (const PointAnswer* answer = feed.answer(); answer != nullptr && answer->of.model < models_.size()) {
    const std::size_t of = answer->of.model;
    Model& model = models_[of];
    if (!model.index_of.empty())
      for (const ShiftedPoint& one : model.dents.take(*answer, *scene_->models[of].cloud))
        splats_->move(of, model.index_of[one.point], one.place_mm);
  }
  // One question a picture, about the touched model, else each in turn.
  const render::Frame& frame = now.tick.frame;
  const bool touching =
      frame.contact && frame.model >= 0 && static_cast<std::size_t>(frame.model) < models_.size();
  const std::size_t of =
      touching ? static_cast<std::size_t>(frame.model) : asks_++ % std::max<std::size_t>(1, models_.size());
  if (of >= models_.size() || models_[of].index_of.empty() || !models_[of].known) return;
  Model& model = models_[of];
  std::optional<std::uint32_t> touched;
  if (touching)
    touched = nearest(
        of, model.world_from_model.inverse() * frame.god_object_mm - scene_->models[of].cloud->origin_mm);
  if (const auto question =
          model.dents.question(static_cast<std::uint32_t>(of), touched, model.known->neighbours))
    feed.ask(*question);
}

std::size_t SceneView::shifted() const noexcept {
  std::size_t all = 0;
  for (const Model& model : models_) all += model.dents.shifted();
  return all;
}

void SceneView::ask_stars(std::size_t model) {
  if (stars_.valid() || models_[model].stars) return;
  stars_of_ = model;
  stars_ = std::async(std::launch::async, [shown = scene_, model] {
    return std::make_shared<const local_delaunay::LocalDelaunayMesh>(
        local_delaunay::LocalDelaunayMesh::build(*shown->models[model].cloud, kStarThreads));
  });
}

void SceneView::ask_grid(std::size_t model) {
  if (grid_.valid() || models_[model].grid || !models_[model].known) return;
  grid_of_ = model;
  grid_ = std::async(std::launch::async, [shown = scene_, model, known = models_[model].known] {
    const cloud::Cloud& cloud = *shown->models[model].cloud;
    return std::make_shared<const search::UniformGrid>(search::UniformGrid::build(
        cloud, kCellResolutions * usual_resolution_mm(cloud, known->neighbours), kStarThreads));
  });
}

void SceneView::draw_cells(const Overlay& overlay, const Model& model, const cloud::Cloud& cloud,
                           const WatchedTick& now) const {
  if (!model.grid) return;
  const search::Lattice& lattice = model.grid->lattice();
  const geometry::RigidTransform model_from_world = model.world_from_model.inverse();
  const auto local = [&](const Vec3& world_mm) {
    return Vec3(model_from_world * world_mm - cloud.origin_mm);
  };
  int drawn = 0;
  search::visit_cells(
      *model.grid, local(now.tick.frame.god_object_mm), local(now.tick.hip_mm), Vec3::Zero(),
      [&](const search::Cell& cell) {
        const Vec3 at{static_cast<double>(cell.x), static_cast<double>(cell.y), static_cast<double>(cell.z)};
        const Vec3 low_mm = cloud.origin_mm + lattice.low_mm + lattice.unit_mm * at;
        const bool holds = !model.grid->find(cell).empty();
        overlay.box(corners_of(low_mm, Vec3(low_mm + Vec3::Constant(lattice.unit_mm)),
                               [&](const Vec3& p) { return Vec3(model.world_from_model * p); }),
                    holds ? kCellColour : kEmptyCellColour, holds ? 2.0f : 1.0f, holds ? 1.0f : 0.6f);
        return ++drawn < kMostCells;
      });
}

std::optional<std::uint32_t> SceneView::nearest(std::size_t index, const Vec3& local_mm) {
  Model& model = models_[index];
  if (!model.known || model.order.empty()) return std::nullopt;
  const cloud::Cloud& cloud = *scene_->models[index].cloud;
  double least = distance_sq(cloud, model.nearest, local_mm);
  for (int step = 0; step < kLongestWalk; ++step) {
    const std::uint32_t from = model.nearest;
    for (const std::uint32_t other : model.known->neighbours.of[from]) {
      const double sq = distance_sq(cloud, other, local_mm);
      if (sq >= least) continue;
      least = sq;
      model.nearest = other;
    }
    if (model.nearest == from) break;
  }
  const double box_mm = model.known->half_box_mm(cloud, model.nearest).norm();
  if (least > kStuckBoxes * kStuckBoxes * box_mm * box_mm) model.nearest = nearest_of_all(cloud, local_mm);
  return model.nearest;
}

Hit SceneView::on_surface(const Hit& hit, const Vec3& eye_mm) {
  Vec3 point_mm = hit.place_mm;
  double least_sq = HUGE_VAL;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    const cloud::Cloud& cloud = *scene_->models[i].cloud;
    const std::optional<std::uint32_t> near =
        nearest(i, models_[i].world_from_model.inverse() * hit.place_mm - cloud.origin_mm);
    if (!near) continue;
    const Vec3 at_mm = models_[i].world_from_model * cloud.point_mm(*near);
    const double sq = (at_mm - hit.place_mm).squaredNorm();
    if (sq >= least_sq) continue;
    least_sq = sq;
    point_mm = at_mm;
  }
  const Vec3 ray = (hit.place_mm - eye_mm).normalized();
  // Along an edge-on plane the ray would go far: the point's depth is used instead.
  const double facing = hit.normal.dot(ray);
  const Vec3 n = std::abs(facing) > kSeenOnEdge ? hit.normal : ray;
  Hit on = hit;
  on.place_mm = eye_mm + ray * (n.dot(point_mm - eye_mm) / n.dot(ray));
  return on;
}

void SceneView::draw_facets(const Overlay& overlay, const Model& model, std::uint32_t point) const {
  const std::uint32_t place = model.star_place[point];
  if (place == local_delaunay::kNoPlace) return;
  const local_delaunay::Ring ring = model.stars->ring(place);
  const auto world = [&](std::uint32_t at) {
    return Vec3(model.world_from_model * Vec3(model.stars->origin_mm() + model.stars->at(at)));
  };
  for (std::uint32_t k = 0; k < ring.size; ++k)
    if (ring.has_sector(k))
      overlay.triangle({world(place), world(ring.of[k]), world(ring.of[ring.next(k)])}, kFacetColour);
}

void SceneView::draw_near(const Overlay& overlay, const WatchedTick& now, const NearChoice& choice) {
  const render::Frame& frame = now.tick.frame;
  if (!choice.any() || !frame.contact || frame.model < 0) return;
  const auto index = static_cast<std::size_t>(frame.model);
  if (index >= models_.size()) return;
  if (choice.facets) ask_stars(index);
  if (choice.cells) ask_grid(index);
  Model& model = models_[index];
  const render::ModelInput& input = scene_->models[index];
  const cloud::Cloud& cloud = *input.cloud;
  if (choice.cells) draw_cells(overlay, model, cloud, now);
  const Vec3 local_mm = model.world_from_model.inverse() * frame.god_object_mm - cloud.origin_mm;
  const std::optional<std::uint32_t> point = nearest(index, local_mm);
  if (!point) return;
  const auto world = [&](std::uint32_t at) { return Vec3(model.world_from_model * cloud.point_mm(at)); };
  if (choice.facets && model.stars) draw_facets(overlay, model, *point);
  for (const std::uint32_t other : model.known->neighbours.of[*point]) {
    if (other == *point) continue;
    if (choice.neighbours) {
      overlay.line(world(*point), world(other), kNearColour, 2.0f);
      overlay.ball(world(other), kNearColour, 3.5f, true);
    }
    if (!choice.boxes) continue;
    const Vec3 half_mm = model.known->half_box_mm(cloud, other), at_mm = cloud.point_mm(other);
    overlay.box(corners_of(Vec3(at_mm - half_mm), Vec3(at_mm + half_mm),
                           [&](const Vec3& p) { return Vec3(model.world_from_model * p); }),
                kBoxColour, 1.0f, 0.6f);
  }
}

namespace {

/// Half a question is for points around the touched place. The other half finds the rest of a dent, which
/// grows outwards by up to 128 points a frame.
constexpr std::size_t kAroundTouch = PointQuestion::kMost / 2;
static_assert(kAroundTouch < PointQuestion::kMost);

Vec3f read_place(const cloud::Cloud& cloud, std::uint32_t point) {
  return {cloud.x_mm[point], cloud.y_mm[point], cloud.z_mm[point]};
}

}  // namespace

std::optional<PointQuestion> DentView::question(std::uint32_t model,
                                                const std::optional<std::uint32_t>& touched,
                                                const search::NeighbourTable& neighbours) {
  PointQuestion asked;
  asked.model = model;
  std::unordered_set<std::uint32_t> in;
  const auto add = [&](std::uint32_t point) {
    if (asked.count < PointQuestion::kMost && in.insert(point).second) asked.point[asked.count++] = point;
  };
  if (touched) {
    add(*touched);
    for (std::size_t at = 0; at < asked.count && asked.count < kAroundTouch; ++at)
      for (const std::uint32_t other : neighbours.of[asked.point[at]])
        if (asked.count < kAroundTouch) add(other);
  }
  for (std::size_t tried = 0; tried < turn_.size() && asked.count < PointQuestion::kMost; ++tried) {
    next_ = (next_ + 1) % turn_.size();
    add(turn_[next_]);
    // Neighbours of a moved point probably moved too: the search reaches the dent's border.
    if (moved_.contains(turn_[next_]))
      for (const std::uint32_t other : neighbours.of[turn_[next_]])
        if (!in_turn_.contains(other)) add(other);
  }
  if (asked.count == 0) return std::nullopt;
  return asked;
}

std::vector<ShiftedPoint> DentView::take(const PointAnswer& answer, const cloud::Cloud& cloud) {
  std::vector<ShiftedPoint> shifted;
  if (!answer.known) {
    for (const auto& [point, place_mm] : moved_) shifted.push_back({point, read_place(cloud, point)});
    moved_.clear();
    return shifted;
  }
  for (std::size_t i = 0; i < answer.of.count; ++i) {
    const std::uint32_t point = answer.of.point[i];
    if (point >= cloud.size()) continue;
    const Vec3f read_mm = read_place(cloud, point);
    const auto known = moved_.find(point);
    const Vec3f before_mm = known == moved_.end() ? read_mm : known->second;
    const Vec3f now_mm = answer.place_mm[i];
    if (now_mm == before_mm) continue;
    shifted.push_back({point, now_mm});
    if (now_mm == read_mm)
      moved_.erase(point);
    else
      moved_[point] = now_mm;
    if (in_turn_.insert(point).second) turn_.push_back(point);
  }
  return shifted;
}

void MouseHand::wheel(double steps) noexcept {
  press_mm_ = std::clamp(press_mm_ * std::pow(kWheelFactor, steps), kLeastPressMm, kMostPressMm);
}

std::optional<Vec3> MouseHand::goal_mm(const std::optional<Hit>& hit, const Vec3& ray_place_mm,
                                       const Camera& camera, const device::DeviceMap& map, bool pressed) {
  if (hit) last_ = hit;
  if (!last_) return std::nullopt;
  const double factor = map.world_per_device;
  const Vec3 towards_eye = -camera.forward();
  if (!hit) return Vec3(ray_place_mm + kHoverMm * factor * towards_eye);
  const Vec3 outward = hit->normal.norm() > 0.0 ? hit->normal : towards_eye;
  return Vec3(hit->place_mm + (pressed ? -press_mm_ : kHoverMm) * factor * outward);
}

}  // namespace palpate::experiments
