#include "toolkit/local_delaunay/deformable_mesh.h"

#include <algorithm>

#include "toolkit/local_delaunay/planar_voronoi_cell.h"

namespace palpate::local_delaunay {
namespace {

/// Every long ring gets the room of the longest.
constexpr auto kLongRoom = static_cast<std::uint32_t>(kMaxCorners);
constexpr std::uint32_t kLongWords = kLongRoom + 2;  // plus size and open sectors
/// A random point has nine or more neighbours once in thirty, and a split adds to two rings: less than one
/// ring per split becomes long.
constexpr std::size_t kRoomsASplit = 1;

constexpr std::uint32_t bits_below(std::uint32_t k) noexcept {
  return (1u << k) - 1u;
}

}  // namespace

DeformableMesh::DeformableMesh(LocalDelaunayMesh& mesh, BlockBvh& tree, std::size_t spare, int threads)
    : mesh_(&mesh), tree_(&tree), built_(mesh.size()), used_(built_), parents_(spare) {
  const std::size_t most = built_ + spare;
  // Long rings are stored back to back and get room to grow. All others are stored in full, because new
  // points are far off in the order.
  std::vector<std::uint32_t> roomy;
  mesh.wide_.resize(most);
  for (std::uint32_t place = 0; place < built_; ++place) {
    const Ring old = mesh.ring(place);
    std::uint32_t& info = mesh.places_[place].info;
    if (old.size <= kInlineRing) {
      mesh.wide_[place].fill(place);
      std::copy_n(old.of, old.size, mesh.wide_[place].begin());
      info = (info & LocalDelaunayMesh::kPlaceBits) | short_info(old.size, old.open);
      continue;
    }
    mesh.places_[place].set_apart(static_cast<std::uint32_t>(roomy.size()));
    roomy.insert(roomy.end(), {old.size, old.open});
    roomy.insert(roomy.end(), old.of, old.of + old.size);
    roomy.resize(roomy.size() + kLongRoom - old.size, place);
  }
  for (std::size_t i = 0; i < kRoomsASplit * spare; ++i)
    free_rooms_.push_back(static_cast<std::uint32_t>(roomy.size() + i * kLongWords));
  std::reverse(free_rooms_.begin(), free_rooms_.end());
  roomy.resize(roomy.size() + kRoomsASplit * spare * kLongWords);
  mesh.long_rings_ = std::move(roomy);
  // Unused places have no triangle, so nothing finds them.
  PackedVertex nowhere = built_ > 0 ? mesh.places_[0] : PackedVertex{};
  nowhere.info = short_info(0, 0);
  mesh.places_.resize(most, nowhere);
  for (std::size_t place = built_; place < most; ++place)
    mesh.wide_[place].fill(static_cast<std::uint32_t>(place));
  if (!mesh.closed_component_of_.empty()) mesh.closed_component_of_.resize(most, 0);
  const std::size_t blocks = (most + kBlockPlaces - 1) / kBlockPlaces;
  changed_.resize(blocks);
  is_changed_.assign(blocks, 0);
  tree = BlockBvh::build(mesh, threads);
}

std::size_t DeformableMesh::bytes() const noexcept {
  return parents_.capacity() * sizeof(parents_[0]) +
         (free_rooms_.capacity() + changed_.capacity()) * sizeof(std::uint32_t) + is_changed_.capacity();
}

std::uint32_t DeformableMesh::short_info(std::uint32_t size, std::uint32_t open) noexcept {
  return size | (open << LocalDelaunayMesh::kOpenShift) | LocalDelaunayMesh::kRingStoredApart;
}

bool DeformableMesh::is_long(std::uint32_t place) const noexcept {
  return (mesh_->places_[place].info & LocalDelaunayMesh::kSizeMask) == LocalDelaunayMesh::kLong;
}

DeformableMesh::Row DeformableMesh::row(std::uint32_t place) noexcept {
  if (is_long(place)) {
    std::uint32_t* const words = mesh_->long_rings_.data() + mesh_->places_[place].apart();
    return {words + LocalDelaunayMesh::kLongHead, words[0], words[1]};
  }
  const std::uint32_t info = mesh_->places_[place].info;
  return {mesh_->wide_[place].data(), info & LocalDelaunayMesh::kSizeMask,
          info >> LocalDelaunayMesh::kOpenShift & LocalDelaunayMesh::kOpenMask};
}

void DeformableMesh::set_size(std::uint32_t place, std::uint32_t size, std::uint32_t open) noexcept {
  if (is_long(place)) {
    std::uint32_t* const words = mesh_->long_rings_.data() + mesh_->places_[place].apart();
    words[0] = size;
    words[1] = open;
    return;
  }
  std::uint32_t& info = mesh_->places_[place].info;
  info = (info & LocalDelaunayMesh::kPlaceBits) | short_info(size, open);
}

void DeformableMesh::lengthen(std::uint32_t place) noexcept {
  const Row old = row(place);
  const std::uint32_t room = free_rooms_.back();
  free_rooms_.pop_back();
  std::copy_n(old.of, old.size, mesh_->long_rings_.begin() + room + LocalDelaunayMesh::kLongHead);
  PackedVertex& at = mesh_->places_[place];
  at.info = (at.info & LocalDelaunayMesh::kPlaceBits) | LocalDelaunayMesh::kLong |
            LocalDelaunayMesh::kRingStoredApart;
  at.set_apart(room);
  set_size(place, old.size, old.open);
}

void DeformableMesh::shorten(std::uint32_t place) noexcept {
  const Row old = row(place);
  PackedVertex& at = mesh_->places_[place];
  free_rooms_.push_back(at.apart());
  auto& ring = mesh_->wide_[place];
  ring.fill(place);
  std::copy_n(old.of, old.size, ring.begin());
  at.info = (at.info & LocalDelaunayMesh::kPlaceBits) | short_info(old.size, old.open);
}

/// True if the ring can grow by one; `rooms` is the number left for rings that become long.
bool DeformableMesh::can_insert(std::uint32_t place, std::size_t& rooms) const noexcept {
  const std::uint32_t size = mesh_->ring(place).size;
  if (size != kInlineRing || is_long(place)) return size < kLongRoom;
  if (rooms == 0) return false;
  --rooms;
  return true;
}

void DeformableMesh::replace(std::uint32_t place, std::uint32_t old, std::uint32_t by) noexcept {
  const Row ring = row(place);
  *std::find(ring.of, ring.of + ring.size, old) = by;
}

/// Inserts between `before` and the next point, whose sector becomes two.
void DeformableMesh::insert_after(std::uint32_t place, std::uint32_t before, std::uint32_t added) noexcept {
  if (!is_long(place) && row(place).size == kInlineRing) lengthen(place);
  const Row ring = row(place);
  const auto at = static_cast<std::uint32_t>(std::find(ring.of, ring.of + ring.size, before) - ring.of) + 1;
  std::copy_backward(ring.of + at, ring.of + ring.size, ring.of + ring.size + 1);
  ring.of[at] = added;
  const std::uint32_t low = bits_below(at);
  set_size(place, ring.size + 1, (ring.open & low) | (ring.open & ~low) << 1);
}

/// Merges the two sectors beside `gone`, both present. It must not be first in the ring.
void DeformableMesh::erase(std::uint32_t place, std::uint32_t gone) noexcept {
  const Row ring = row(place);
  const auto at = static_cast<std::uint32_t>(std::find(ring.of, ring.of + ring.size, gone) - ring.of);
  std::copy(ring.of + at + 1, ring.of + ring.size, ring.of + at);
  ring.of[ring.size - 1] = place;
  const std::uint32_t low = bits_below(at);
  set_size(place, ring.size - 1, (ring.open & low) | (ring.open >> 1 & ~low));
  // A ring built long never shrinks to this: only inserted points are removed.
  if (is_long(place) && ring.size - 1 == kInlineRing) shorten(place);
}

void DeformableMesh::mark_block(std::uint32_t block) noexcept {
  if (is_changed_[block] != 0) return;
  is_changed_[block] = 1;
  changed_[(first_changed_ + changed_count_++) % changed_.size()] = block;
}

/// Calls use(block) for the blocks with the place's triangles, some repeatedly; a triangle is stored with its
/// lowest corner.
template <class Use>
void DeformableMesh::for_blocks_of(std::uint32_t place, Use&& use) const noexcept {
  use(place / kBlockPlaces);
  const Ring ring = mesh_->ring(place);
  for (std::uint32_t k = 0; k < ring.size; ++k)
    if (ring.of[k] < place) use(ring.of[k] / kBlockPlaces);
}

void DeformableMesh::mark(std::uint32_t place) noexcept {
  for_blocks_of(place, [this](std::uint32_t block) noexcept { mark_block(block); });
}

/// After mark(), for blocks that gained triangles: grows those that must wait for their turn.
void DeformableMesh::grow_star(std::uint32_t place) noexcept {
  if (changed_count_ <= kMaxRefitBlocks) return;
  const Ring ring = mesh_->ring(place);
  for (std::uint32_t k = 0; k < ring.size; ++k) {
    if (!ring.has_sector(k)) continue;
    const std::uint32_t b = ring.of[k], c = ring.of[ring.next(k)];
    for (const std::uint32_t corner : {place, b, c})
      tree_->grow(std::min({place, b, c}) / kBlockPlaces, mesh_->at(corner));
  }
}

void DeformableMesh::set(std::uint32_t place, const Vec3f& to) noexcept {
  PackedVertex& point = mesh_->places_[place];
  point.x_mm = to.x();
  point.y_mm = to.y();
  point.z_mm = to.z();
  mark(place);
  if (changed_count_ <= kMaxRefitBlocks) return;
  const Vec3 at = mesh_->at(place);
  for_blocks_of(place, [&](std::uint32_t block) noexcept { tree_->grow(block, at); });
}

std::uint32_t DeformableMesh::split(std::uint32_t a, std::uint32_t b) noexcept {
  if (used_ == most()) return kNoPlace;
  const Ring around = mesh_->ring(a);
  const std::uint32_t k = around.find(b);
  if (k == around.size) return kNoPlace;
  const std::uint32_t before = around.previous(k);
  const std::uint32_t left = around.has_sector(k) ? around.of[around.next(k)] : kNoPlace;
  const std::uint32_t right = around.has_sector(before) ? around.of[before] : kNoPlace;
  if (left == right) return kNoPlace;  // no triangle, or two with the same corners
  std::size_t rooms = free_rooms_.size();
  for (const std::uint32_t across : {left, right})
    if (across != kNoPlace && !can_insert(across, rooms)) return kNoPlace;

  const std::uint32_t place = used_++;
  parents_[place - built_] = {a, b};
  replace(a, b, place);
  replace(b, a, place);
  if (left != kNoPlace) insert_after(left, a, place);
  if (right != kNoPlace) insert_after(right, b, place);
  std::array<std::uint32_t, kInlineRing> ring;
  ring.fill(place);
  std::uint32_t size = 0, open = 0;
  // Counter-clockwise: from b over the left to a, and back over the right.
  if (left != kNoPlace) {
    ring[size++] = b;
    ring[size++] = left;
    ring[size++] = a;
    if (right != kNoPlace)
      ring[size++] = right;
    else
      open = 1u << 2;
  } else {
    ring[size++] = a;
    ring[size++] = right;
    ring[size++] = b;
    open = 1u << 2;
  }
  mesh_->wide_[place] = ring;
  const Vec3f middle = (0.5 * (mesh_->at(a) + mesh_->at(b))).cast<float>();
  mesh_->places_[place] = {
      middle.x(), middle.y(), middle.z(), mesh_->places_[a].info & LocalDelaunayMesh::kPlaceBits, {}};
  set_size(place, size, open);
  if (!mesh_->closed_component_of_.empty())
    mesh_->closed_component_of_[place] = mesh_->closed_component_of_[a];
  mark(place);
  grow_star(place);
  return place;
}

void DeformableMesh::undo_split() noexcept {
  const std::uint32_t place = --used_;
  mark(place);
  const auto [a, b] = parents(place);
  const Row ring = row(place);
  for (std::uint32_t k = 0; k < ring.size; ++k)
    if (ring.of[k] != a && ring.of[k] != b) erase(ring.of[k], place);
  replace(a, place, b);
  replace(b, place, a);
  mesh_->places_[place].info = short_info(0, 0);
  mesh_->wide_[place].fill(place);
  mark(a);
  grow_star(a);
}

void DeformableMesh::refit() noexcept {
  std::array<std::uint32_t, kMaxRefitBlocks> blocks;
  const std::size_t count = std::min(changed_count_, blocks.size());
  for (std::size_t i = 0; i < count; ++i) {
    blocks[i] = changed_[(first_changed_ + i) % changed_.size()];
    is_changed_[blocks[i]] = 0;
  }
  first_changed_ += count;
  changed_count_ -= count;
  std::sort(blocks.begin(), blocks.begin() + static_cast<std::ptrdiff_t>(count));
  tree_->refit(*mesh_, {blocks.data(), count});
}

void DeformableMesh::refit_all() noexcept {
  while (changed_count_ > 0) refit();
}

std::size_t DeformableMesh::bytes_for(std::size_t points, std::size_t spare) noexcept {
  const std::size_t blocks = (points + spare + kBlockPlaces - 1) / kBlockPlaces;
  const std::size_t own =
      spare * (sizeof(std::array<std::uint32_t, 2>) + kRoomsASplit * sizeof(std::uint32_t)) +
      blocks * (sizeof(std::uint32_t) + 1);
  const std::size_t grown =
      spare * (sizeof(PackedVertex) + kRoomsASplit * kLongWords * sizeof(std::uint32_t)) +
      (points + spare) * sizeof(std::array<std::uint32_t, kInlineRing>) +
      spare / kBlockPlaces * (sizeof(Layer) + sizeof(BvhNode) / kBvhWidth);
  return own + grown;
}

}  // namespace palpate::local_delaunay
