#include <algorithm>
#include <cmath>

#include "toolkit/core/parallel.h"
#include "toolkit/stars/draft.h"

namespace palpate::stars {
namespace {

/// What each round leaves out: what rises more than 45, 30, 58 and 37 degrees off the plane of what is
/// confirmed. The steep ones let creases through, the flat ones keep sheets apart; no one angle serves both.
constexpr std::array<double, 6> kSteepest = {0.71, 0.5, 0.85, 0.6, 0.71, 0.5};
/// A neighbour's triangles count so much beside the point's own: sixteen of them outvote it four to one.
constexpr double kBesideShare = 0.25;
constexpr std::size_t kMendedPerChunk = 1024;

/// The plane of a point's confirmed triangles; else of its neighbours' that are confirmed.
Vec3 confirmed_normal(const Draft& draft, std::uint32_t i) noexcept {
  const auto area = [&draft](std::uint32_t of) {
    const Star& star = draft.star[of];
    const Vec3 p = draft.at(of);
    Vec3 sum = Vec3::Zero();
    for (std::uint32_t k = 0; k < star.size; ++k)
      if (star.is_agreed(k)) sum += (draft.at(star.ring[k]) - p).cross(draft.at(star.ring[star.next(k)]) - p);
    return sum;
  };
  Vec3 sum = area(i);
  const Vec3 own = draft.normal[i].cast<double>();
  for (const std::uint32_t other : draft.near[i]) {
    if (other == i) break;
    Vec3 there = area(other);
    const double size = there.norm();
    if (!(size > 0.0)) continue;
    const double side = sum == Vec3::Zero() ? own.dot(there) : sum.dot(there);
    if (side < 0.0) there = -there;
    sum += kBesideShare * there;
  }
  const double size = sum.norm();
  return size > 0.0 ? Vec3(sum / size) : own;
}

/// Whom others have in their rings, without being in those that they have in theirs: a point in a sparse
/// place is among the nearest of few.
class Offers {
 public:
  Offers(const Draft& draft, const std::vector<std::uint32_t>& doubtful) {
    for (const std::uint32_t i : doubtful) {
      const Star& star = draft.star[i];
      for (std::uint32_t k = 0; k < star.size; ++k)
        if (!draft.star[star.ring[k]].has_neighbour(i)) offers_.push_back({star.ring[k], i});
    }
    std::sort(offers_.begin(), offers_.end());
    points_.reserve(offers_.size());
    for (const auto& offer : offers_) points_.push_back(offer[1]);
  }
  [[nodiscard]] std::span<const std::uint32_t> to(std::uint32_t i) const noexcept {
    const auto first = std::lower_bound(offers_.begin(), offers_.end(), std::array{i, 0u});
    const auto last = std::lower_bound(first, offers_.end(), std::array{i + 1, 0u});
    return {points_.data() + (first - offers_.begin()), static_cast<std::size_t>(last - first)};
  }

 private:
  std::vector<std::array<std::uint32_t, 2>> offers_;  ///< to whom, who
  std::vector<std::uint32_t> points_;
};

}  // namespace

void mend_stars(Draft& draft) {
  const std::size_t n = draft.size();
  std::vector<std::uint32_t> doubtful;
  std::vector<Star> mended;
  for (std::size_t round = 0; round < kSteepest.size(); ++round) {
    doubtful.clear();
    for (std::uint32_t i = 0; i < n; ++i)
      if (draft.welded[i] == 0 && draft.star[i].agreements() < draft.star[i].size) doubtful.push_back(i);
    if (doubtful.empty()) return;
    mended.resize(doubtful.size());
    const Offers offers(draft, doubtful);
    parallel_chunks(doubtful.size(), kMendedPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t d = begin; d < end; ++d) {
        const std::uint32_t i = doubtful[d];
        const Star& old = draft.star[i];
        mended[d] = old;
        Star made = lay_out(draft, i, {confirmed_normal(draft, i), kSteepest[round]}, offers.to(i));
        made.agreed = agreed_sectors(draft, i, made);
        const auto opened = [](const Star& s) { return s.size - s.sectors(); };
        if (made.agreements() > old.agreements() && opened(made) <= opened(old)) mended[d] = made;
      }
    });
    for (std::size_t d = 0; d < doubtful.size(); ++d) draft.star[doubtful[d]] = mended[d];
    parallel_chunks(n, kMendedPerChunk, draft.threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) {
        const auto i = static_cast<std::uint32_t>(k);
        draft.star[i].agreed = agreed_sectors(draft, i, draft.star[i]);
      }
    });
  }
}

}  // namespace palpate::stars
