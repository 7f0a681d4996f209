#include "baselines/renderers/sphere_probe.h"

#include <algorithm>
#include <cmath>

#include "baselines/mesh/surface_mesh.h"
#include "toolkit/geometry/half_space_projection.h"

namespace palpate::baselines {
namespace {

/// Thickness of the sphere's contact layer in rounding bounds of the mesh. Constraints keep to its middle and
/// motion stops a quarter inside, so rounding cannot confuse them.
constexpr double kSkinRoundings = 64.0;
constexpr double kKeep = 0.5;
constexpr double kStop = 0.25;
/// Newton's steps end this near to the stop.
constexpr double kStopWithin = 1.0 / 16.0;
/// Newton steps for one facet. Each about doubles the digits; 53 bits need six, a grazing touch some more.
constexpr int kMaxNewton = 32;
/// Contacts whose normals span less are one plane for the pair solver; two such planes give coordinates to
/// 2^-53 / 2^-17 of the depth.
constexpr double kFlatContacts = 0x1p-17;
/// Rounded operations between the HIP's distance and a goal.
constexpr int kGoalOperations = 64;
/// First reach of a facet list beyond the sphere, in edges (or radii, if more).
constexpr double kReachEdges = 2.0;
/// A list is renewed when less than this share of its reach is left.
constexpr double kMinRoom = 0.5;
/// Most halvings of the reach of a list that is too long.
constexpr int kMaxHalvings = 12;
/// Lengths are rounded; the sum of a way's pieces is not below the way.
constexpr double kTravelRounding = 1.0 + 0x1p-40;
/// Moves of a trial for the planes of several models.
constexpr int kMaxTrialMoves = 32;
/// Facets within this share of the radius of the deepest count with it.
constexpr double kSameDepth = 0x1p-20;
/// Planes given by one model: as many as may hold the sphere at once.
constexpr std::size_t kMaxPlanesGiven = kMaxSphereContacts;
static_assert(kMaxPlanesGiven <= render::kMaxPlanesPerTouch);
/// Size of a sphere that starts too near to a facet, as a share of the room.
constexpr double kBeginShare = 1.0 - 0x1p-10;
/// Smallest sphere in skins; a smaller one does not exist.
constexpr double kMinSkins = 16.0;

}  // namespace

double SphereProbe::least_radius_mm(const SurfaceMesh& mesh) noexcept {
  return kMinSkins * kSkinRoundings * mesh.rounding_mm();
}

SphereProbe::SphereProbe(const SurfaceMesh& mesh, const SegmentIndex& index, double radius_mm,
                         double spacing_mm, SphereTip tip)
    : mesh_(&mesh),
      index_(&index),
      tip_(tip),
      radius_(radius_mm),
      most_reach_(std::max(radius_mm, kReachEdges * spacing_mm)),
      skin_(kSkinRoundings * mesh.rounding_mm()),
      near_(kMaxNearFacets),
      planes_(kMaxNearFacets) {}

void SphereProbe::reset(const Vec3& hip) noexcept {
  place(hip);
  moves_ = 0;
}

void SphereProbe::place(const Vec3& hip) noexcept {
  centre_ = hip;
  count_ = 0;
  listed_ = 0;
  reach_ = -1.0;
  bound_hit_ = false;
  size_ = radius_;
  const std::uint32_t facet = index_->nearest(hip, radius_ + skin_);
  if (facet == kNoFacet) return;
  size_ = std::min(radius_, kBeginShare * std::sqrt(closest_on_facet(mesh_->facet(facet), hip).distance_sq));
}

Vec3 SphereProbe::at_tip(const Vec3& centre, const Vec3& hip) const noexcept {
  if (tip_ == SphereTip::kCentre) return centre;
  const Vec3 in = hip - centre;
  const double length = in.norm();
  return length > size_ ? Vec3(centre + in * (size_ / length)) : hip;
}

bool SphereProbe::update(const Vec3& hip) noexcept {
  bound_hit_ = false;
  tests_ = 0;
  if (size_ < radius_) grow();
  if (size_ < kMinSkins * skin_) {  // started on the surface: no body yet, so nothing holds it
    place(hip);
    return false;
  }
  touched_ = count_ > 0;
  double rest = 0.0;
  const bool rests = settle(hip, kMaxSphereMoves, rest);
  if (!rests) {
    bound_hit_ = true;
    refresh();
  }
  // Cut short, it may be just off what holds it.
  return (count_ > 0 || (bound_hit_ && touched_)) && (hip - centre_).norm() > rest;
}

/// Moves until the sphere rests; false if the bounds end it. `rest`: motion that counts as none.
bool SphereProbe::settle(const Vec3& hip, int moves, double& rest) noexcept {
  for (int move = 0; move < moves && tests_ < kMaxSphereTests; ++move) {
    refresh();
    rest = skin_ + gamma(kGoalOperations) * (hip - centre_).norm();
    const Vec3 way = way_to(hip, rest - skin_ + skin_ * kStopWithin);
    const double length = way.norm();
    if (length <= rest || !advance(way, length, rest)) return true;
  }
  return false;
}

void SphereProbe::planes_near(const Vec3& at, const render::ModelPose& pose,
                              render::JointPlanes& planes) noexcept {
  // A trial: the sphere itself is restored.
  const Vec3 centre = centre_;
  const auto contacts = contacts_;
  const std::size_t count = count_;
  const std::uint64_t moved = moves_;
  double rest = 0.0;
  settle(at, kMaxTrialMoves, rest);
  if (reach_ < 0.0) list_near();
  double nearest = size_ + reach_;
  for (std::size_t i = 0; i < listed_; ++i)
    if (near_[i].distance - travelled_ <= nearest)
      nearest =
          std::min(nearest, std::sqrt(closest_on_facet(mesh_->facet(near_[i].facet), centre_).distance_sq));
  const double within = std::max(nearest, size_) + skin_ + kSameDepth * size_;
  std::array<Vec3, kMaxSphereContacts> normals;
  std::size_t found = 0;
  for (std::size_t i = 0; i < listed_ && found < kMaxPlanesGiven; ++i) {
    if (near_[i].distance - travelled_ > within) continue;
    const Vec3 point = closest_on_facet(mesh_->facet(near_[i].facet), centre_).point;
    const Vec3 out = centre_ - point;
    const double distance = out.norm();
    if (distance > within || !(distance > 0.0)) continue;
    const Vec3 n = out / distance;
    const bool known =
        std::any_of(normals.begin(), normals.begin() + static_cast<std::ptrdiff_t>(found),
                    [&](const Vec3& m) { return (m - n).norm() < geometry::kMinIndependence; });
    if (known) continue;
    normals[found++] = n;
    const Vec3 world = pose.direction_to_world(n);
    planes.add({world, world.dot(pose.to_world(point)) + size_});
  }
  centre_ = centre;
  contacts_ = contacts;
  count_ = count;
  moves_ = moved;
  reach_ = -1.0;  // the list may be centred elsewhere now
}

/// Grows the sphere into the available room.
void SphereProbe::grow() noexcept {
  const double was = size_;
  const std::uint32_t facet = index_->nearest(centre_, 2.0 * radius_ + skin_);
  const double room = facet == kNoFacet
                          ? radius_
                          : std::sqrt(closest_on_facet(mesh_->facet(facet), centre_).distance_sq) - skin_;
  size_ = std::min(radius_, std::max(size_, room));
  if (size_ != was) reach_ = -1.0;
}

/// Updates a contact to the present sphere; false if they do not touch.
bool SphereProbe::measure(SphereContact& contact) const noexcept {
  contact.place = closest_on_facet(mesh_->facet(contact.facet), centre_);
  const double distance = std::sqrt(contact.place.distance_sq);
  contact.gap = distance - size_;
  if (!(distance > 0.0) || contact.gap > skin_) return false;
  contact.normal = (centre_ - contact.place.point) / distance;
  return true;
}

void SphereProbe::refresh() noexcept {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count_; ++i)
    if (measure(contacts_[i])) contacts_[kept++] = contacts_[i];
  count_ = kept;
}

/// The way to the place nearest to the HIP that the contacts allow, computed around the centre to keep
/// rounding relative to the depth.
Vec3 SphereProbe::way_to(const Vec3& hip, double slack) noexcept {
  if (count_ == 0) return hip - centre_;
  std::array<geometry::HalfSpace, kMaxSphereContacts> planes;
  for (std::size_t i = 0; i < count_; ++i)
    planes[i] = {contacts_[i].normal, kKeep * skin_ - contacts_[i].gap};
  const geometry::NearestFeasible found =
      geometry::nearest_feasible(std::span(planes).first(count_), hip - centre_, slack, kFlatContacts);
  for (std::size_t i = 0; i < count_; ++i) contacts_[i].push = found.multiplier_of(i);
  return found.point;
}

/// False if nothing moved and nothing was learnt: the sphere rests.
bool SphereProbe::advance(const Vec3& way, double length, double rest) noexcept {
  ++moves_;
  double room = reach_ < 0.0 ? -1.0 : reach_ - (centre_ - list_centre_).norm();
  if (room < length) {
    if (room < kMinRoom * reach_ || reach_ < 0.0) {
      list_near();
      room = reach_;
    }
    if (listed_ == 0 && room < length) {
      const double clear = clearance(length + size_) - size_ - skin_;
      if (clear > room) {
        move(way, length, std::min(1.0, clear / length));
        return true;
      }
    }
  }
  const Touch touch = first_touch(way, length, std::min(1.0, room / length));
  tests_ += listed_;
  move(way, length, touch.fraction);
  if (touch.facet == kNoFacet) return true;
  touched_ = true;
  for (std::size_t i = 0; i < count_; ++i)
    if (contacts_[i].facet == touch.facet) return touch.fraction * length > rest;
  remember(touch.facet);
  return true;
}

/// Adds a contact; of too many it drops the one with the least push.
void SphereProbe::remember(std::uint32_t facet) noexcept {
  std::size_t slot = count_;
  if (count_ == kMaxSphereContacts) {
    slot = 0;
    for (std::size_t i = 1; i < count_; ++i)
      if (contacts_[i].push < contacts_[slot].push) slot = i;
  } else {
    ++count_;
  }
  contacts_[slot] = {};
  contacts_[slot].facet = facet;
}

void SphereProbe::list_near() noexcept {
  double reach = reach_ > 0.0 ? std::min(2.0 * reach_, most_reach_) : most_reach_;
  std::size_t count = index_->gather(centre_, size_ + skin_ + reach, near_);
  for (int i = 0; count > near_.size() && i < kMaxHalvings; ++i) {
    reach *= 0.5;
    count = index_->gather(centre_, size_ + skin_ + reach, near_);
  }
  if (count > near_.size()) {
    bound_hit_ = true;
    count = near_.size();
  }
  tests_ += count;
  listed_ = count;
  reach_ = reach;
  list_centre_ = centre_;
  travelled_ = 0.0;
  std::fill_n(planes_.begin(), count, geometry::HalfSpace{Vec3::Zero(), HUGE_VAL});
  // The first touch among equals must not depend on the tree; near facets first shorten the way.
  std::sort(near_.begin(), near_.begin() + static_cast<std::ptrdiff_t>(count),
            [](const NearFacet& a, const NearFacet& b) {
              return a.distance != b.distance ? a.distance < b.distance : a.facet < b.facet;
            });
}

void SphereProbe::move(const Vec3& way, double length, double fraction) noexcept {
  centre_ += way * fraction;
  travelled_ += length * fraction * kTravelRounding;
}

/// Lower bound of the distance to the mesh, at most `most`. Far away it is the distance to the mesh's box,
/// where the tree's float would fail.
double SphereProbe::clearance(double most) const noexcept {
  const geometry::Aabb& box = mesh_->local_box_mm();
  const Vec3 outside = (box.low_mm - centre_).cwiseMax(centre_ - box.high_mm).cwiseMax(0.0);
  const double to_box = outside.norm();
  if (to_box > box.extent_mm().norm()) return std::min(most, to_box);
  const std::uint32_t facet = index_->nearest(centre_, most);
  if (facet == kNoFacet) return most;
  return std::sqrt(closest_on_facet(mesh_->facet(facet), centre_).distance_sq) - 2.0 * index_->margin_mm();
}

SphereProbe::Touch SphereProbe::first_touch(const Vec3& way, double length, double limit) noexcept {
  Touch first{kNoFacet, limit};
  const double size = size_ + skin_ + travelled_;
  const double clear = size_ + (kStop + kStopWithin) * skin_;
  for (std::size_t i = 0; i < listed_; ++i) {
    if (near_[i].distance > size + length * first.fraction) continue;
    const geometry::HalfSpace& plane = planes_[i];
    const double height = plane.normal.dot(centre_) - plane.offset;
    if (height > clear && height + first.fraction * plane.normal.dot(way) > clear) continue;
    const double fraction = touch_fraction(i, way, first.fraction);
    if (fraction < first.fraction) first = {near_[i].facet, fraction};
  }
  return first;
}

/// Share of the way until the sphere touches; `limit` if not before. Renews the facet's bounds.
double SphereProbe::touch_fraction(std::size_t i, const Vec3& way, double limit) noexcept {
  const Facet& f = mesh_->facet(near_[i].facet);
  double t = 0.0;
  for (int step = 0; step < kMaxNewton; ++step) {
    const Vec3 x = centre_ + way * t;
    const FacetPoint place = closest_on_facet(f, x);
    const double distance = std::sqrt(place.distance_sq);
    if (!(distance > 0.0)) return t;
    if (step == 0) {
      near_[i].distance = distance + travelled_;
      const Vec3 normal = (x - place.point) / distance;
      planes_[i] = {normal, normal.dot(place.point)};
    }
    const double rate = (x - place.point).dot(way) / distance;
    if (rate >= 0.0) return limit;
    const double left = distance - size_ - kStop * skin_;
    if (left <= kStopWithin * skin_) return std::min(t, limit);
    t -= left / rate;
    if (t >= limit) return limit;
  }
  return t;
}

Vec3 SphereProbe::shaded_target(const Vec3& hip, std::span<const Vec3f> vertex_normals) noexcept {
  if (count_ == 0) return at_tip(centre_, hip);
  std::array<geometry::HalfSpace, kMaxSphereContacts> flat, smooth;
  std::size_t n = 0;
  for (std::size_t i = 0; i < count_; ++i) {
    const SphereContact& contact = contacts_[i];
    if (!(contact.push > 0.0)) continue;
    const Vec3 m =
        interpolated_normal(mesh_->facet(contact.facet), vertex_normals, contact.place.point, contact.normal);
    flat[n] = {contact.normal, 0.0};
    smooth[n++] = {m, 0.0};
  }
  const double slack = skin_ + gamma(kGoalOperations) * (hip - centre_).norm();
  const Vec3 goal =
      geometry::nearest_feasible(std::span(smooth).first(n), hip - centre_, slack, kFlatContacts).point;
  const Vec3 way = geometry::nearest_feasible(std::span(flat).first(n), goal, slack, kFlatContacts).point;
  const double length = way.norm();
  if (!(length > slack)) return at_tip(centre_, hip);
  const double room = reach_ - (centre_ - list_centre_).norm();
  const Touch touch = first_touch(way, length, std::min(1.0, std::max(room, 0.0) / length));
  return at_tip(centre_ + way * touch.fraction, hip);
}

}  // namespace palpate::baselines
