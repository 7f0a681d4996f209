#include <algorithm>
#include <cmath>
#include <numeric>

#include "toolkit/core/hardware.h"
#include "toolkit/core/parallel.h"
#include "toolkit/local_delaunay/candidate_triangulation.h"

namespace palpate::local_delaunay {
namespace {

/// Limits of successive rounds on the rise off the confirmed plane: 45, 30, 58 and 37 degrees. Steep ones
/// pass creases, flat ones separate sheets; no single angle does both.
constexpr std::array<double, 6> kSteepest = {0.71, 0.5, 0.85, 0.6, 0.71, 0.5};
/// Weight of a neighbour's triangles beside the point's own: sixteen outvote it four to one.
constexpr double kBesideShare = 0.25;
constexpr std::size_t kRepairedPerChunk = 1024;
/// This many doubtful points of sixteen mean noise. Four points on one circle are doubtful together.
constexpr std::uint32_t kRoughLinks = 6;
/// In noise, planes and rises of single points mean little: normals are averaged over the surroundings in
/// several passes, and nearly all that is near belongs to the surface.
constexpr int kNormalPasses = 3;
constexpr double kRoughSteepest = 0.97;
/// Variance across the plane, as a share: from noise of a thirtieth of the spacing to twice that of three
/// tenths. Less is no noise; more is another sheet.
constexpr double kMinRough = 0.0005, kMaxRough = 0.09;
/// If this many times the asking points exceed all points, values are computed for all at once.
constexpr std::size_t kAskedEach = 32;
constexpr std::int32_t kMinGain = 8 * 17;  ///< agreements around each of the seventeen, summed

class StarRepair {
 public:
  explicit StarRepair(CandidateTriangulation& candidate) : candidate_(candidate), slot_(candidate.size()) {
    chunks(candidate.size(), [&](std::uint32_t i) { slot_[i] = kNoPoint; });
  }

  void run() {
    doubtful_ = those_of_all([&](std::uint32_t i) { return is_doubtful(i); });
    if (lay_out_rough()) doubtful_ = those_of_all([&](std::uint32_t i) { return is_doubtful(i); });
    for (const double steepest : kSteepest) {
      if (doubtful_.empty()) return;
      take_areas();
      number(doubtful_);
      offer();
      const Points changed = rebuild_star(steepest);
      number_no_more(doubtful_);
      agree_again(changed);
      Points looked_at = doubtful_;
      looked_at.insert(looked_at.end(), changed.begin(), changed.end());
      make_unique(looked_at);
      doubtful_ = those(looked_at, [&](std::uint32_t i) { return is_doubtful(i); });
    }
  }

 private:
  using Points = std::vector<std::uint32_t>;

  template <class Use>
  void chunks(std::size_t count, Use&& use) const {
    parallel_each(count, kRepairedPerChunk, candidate_.threads,
                  [&](std::size_t i) { use(static_cast<std::uint32_t>(i)); });
  }
  template <class Use>
  void chunks_of(const Points& points, Use&& use) const {
    chunks(points.size(), [&](std::uint32_t k) { use(points[k]); });
  }
  static void make_unique(Points& points) {
    std::sort(points.begin(), points.end());
    points.erase(std::unique(points.begin(), points.end()), points.end());
  }
  /// The points for which `is` holds, in order.
  template <class Is>
  [[nodiscard]] Points those(const Points& of, Is&& is) const {
    return those_of(
        of.size(), [&of](std::size_t k) { return of[k]; }, is);
  }
  template <class Is>
  [[nodiscard]] Points those_of_all(Is&& is) const {
    return those_of(
        candidate_.size(), [](std::size_t k) { return static_cast<std::uint32_t>(k); }, is);
  }
  template <class At, class Is>
  [[nodiscard]] Points those_of(std::size_t count, At&& at, Is&& is) const {
    return parallel_list<std::uint32_t>(count, kRepairedPerChunk, candidate_.threads,
                                        [&](std::size_t k, Points& out) {
                                          if (is(at(k))) out.push_back(at(k));
                                        });
  }

  /// Sets slot_: each point's index among these.
  void number(const Points& points) noexcept {
    for (std::uint32_t k = 0; k < points.size(); ++k) slot_[points[k]] = k;
  }
  void number_no_more(const Points& points) noexcept {
    for (const std::uint32_t i : points) slot_[i] = kNoPoint;
  }
  [[nodiscard]] bool is_doubtful(std::uint32_t i) const noexcept {
    return candidate_.welded[i] == 0 && !candidate_.star[i].has_agreed_all();
  }
  /// Agreement changes only where a star changed.
  void agree_again(const Points& changed) {
    chunks_of(changed, [&](std::uint32_t i) {
      candidate_.star.set_agreed(i, agreed_sectors(candidate_, i, candidate_.star[i]));
      if (!area_.empty()) area_[i] = area_of(i);
    });
  }
  void mark_star(std::uint32_t i, std::vector<std::uint8_t>& marks) const {
    const Star& star = candidate_.star[i];
    marks[i] = 1;
    for (std::uint32_t k = 0; k < star.size; ++k) marks[star.ring[k]] = 1;
  }

  /// In noise: makes flat stars along smoothed planes and keeps those that raise the agreement around. False
  /// if there are none.
  bool lay_out_rough() {
    const Points rough = rough_points();
    if (rough.empty()) return false;
    const std::vector<Vec3f> normal = smooth_normals(rough);
    std::vector<StarTable::Line> former(rough.size());
    // A list of them, each often repeated, would take more memory than the stars.
    std::vector<std::uint8_t> is_changed(candidate_.size(), 0);
    for (std::size_t r = 0; r < rough.size(); ++r) {
      former[r] = candidate_.star.line(rough[r]);
      mark_star(rough[r], is_changed);
    }
    chunks(rough.size(), [&](std::uint32_t r) {
      candidate_.star.put(rough[r], star_in_plane(candidate_, rough[r],
                                                  {normal[r].cast<double>(), kRoughSteepest, false, true}));
    });
    for (const std::uint32_t i : rough) mark_star(i, is_changed);
    const Points changed = those_of_all([&](std::uint32_t i) { return is_changed[i] != 0; });
    release_memory(is_changed);
    std::vector<std::int32_t> gain(candidate_.size(), 0);
    const auto count = [&](std::int32_t sign) {
      chunks_of(changed, [&](std::uint32_t i) {
        gain[i] += sign * static_cast<std::int32_t>(candidate_.star[i].agreements());
      });
    };
    count(-1);
    for (std::size_t r = 0; r < rough.size(); ++r)  // agreement of the new stars is not known yet
      gain[rough[r]] = -static_cast<std::int32_t>(candidate_.star.star_of(rough[r], former[r]).agreements());
    agree_again(changed);
    count(1);
    // Sums over neighbours of neighbours: noise covers more than one place.
    const auto sum = [&](auto&& of, std::uint32_t i) {
      std::int32_t all = of(i);
      for (const std::uint32_t other : candidate_.near[i]) all += of(other);
      return all;
    };
    const auto own = [&](std::uint32_t i) { return gain[i]; };
    std::vector<std::int32_t> around;  // for all points, if most are used more than once
    if (kAskedEach * rough.size() > candidate_.size()) {
      around.resize(candidate_.size());
      chunks(candidate_.size(), [&](std::uint32_t i) { around[i] = sum(own, i); });
    }
    const auto there = [&](std::uint32_t i) { return around.empty() ? sum(own, i) : around[i]; };
    chunks_of(rough, [&](std::uint32_t i) {
      candidate_.rough[i] = static_cast<std::uint8_t>(sum(there, i) >= kMinGain);
    });
    for (std::size_t r = 0; r < rough.size(); ++r) {
      if (candidate_.rough[rough[r]] != 0) {
        candidate_.normal[rough[r]] = normal[r];
        candidate_.crossed[rough[r]] = 0;  // points on both sides were noise
      } else {
        candidate_.star.put_back(rough[r], former[r]);
      }
    }
    agree_again(changed);
    return true;
  }
  [[nodiscard]] Points rough_points() {
    std::vector<std::uint8_t> doubtful_links(candidate_.size(), 0);
    for (const std::uint32_t i : doubtful_)
      for (const std::uint32_t other : candidate_.near[i])
        doubtful_links[other] = static_cast<std::uint8_t>(std::min(doubtful_links[other] + 1, 255));
    return those_of_all([&](std::uint32_t i) {
      if (doubtful_links[i] < kRoughLinks || candidate_.welded[i] != 0) return false;
      const double share = share_across(candidate_, i);
      return share > kMinRough && share < kMaxRough;
    });
  }
  /// Indexed by place in `of`.
  [[nodiscard]] std::vector<Vec3f> smooth_normals(const Points& of) {
    std::vector<Vec3f> normal(of.size()), smooth(of.size());
    number(of);
    const auto at = [&](std::uint32_t i) {
      return slot_[i] == kNoPoint ? candidate_.normal[i] : normal[slot_[i]];
    };
    chunks(of.size(), [&](std::uint32_t r) { normal[r] = candidate_.normal[of[r]]; });
    for (int pass = 0; pass < kNormalPasses; ++pass) {
      chunks(of.size(), [&](std::uint32_t r) {
        const Vec3f own = normal[r];
        Vec3f sum = own;
        for (const std::uint32_t other : candidate_.near[of[r]]) {
          const Vec3f theirs = at(other);
          sum += theirs.dot(own) < 0.0F ? Vec3f(-theirs) : theirs;
        }
        const float size = sum.norm();
        smooth[r] = size > 0.0F ? Vec3f(sum / size) : own;
      });
      normal.swap(smooth);
    }
    number_no_more(of);
    return normal;
  }

  /// Computes all areas, if most are used more than once.
  void take_areas() {
    if (!area_.empty() || kAskedEach * doubtful_.size() <= candidate_.size()) return;
    area_.resize(candidate_.size());
    chunks(candidate_.size(), [&](std::uint32_t i) { area_[i] = area_of(i); });
  }
  [[nodiscard]] Vec3f area_at(std::uint32_t i) const noexcept {
    return area_.empty() ? area_of(i) : area_[i];
  }

  /// Twice the area of the confirmed triangles, as a vector.
  [[nodiscard]] Vec3f area_of(std::uint32_t i) const noexcept {
    const Star& star = candidate_.star[i];
    const Vec3 p = candidate_.at(i);
    Vec3 sum = Vec3::Zero();
    for (std::uint32_t k = 0; k < star.size; ++k)
      if (star.is_agreed(k))
        sum += (candidate_.at(star.ring[k]) - p).cross(candidate_.at(star.ring[star.next(k)]) - p);
    return sum.cast<float>();
  }
  /// The plane of a point's confirmed triangles, else of its neighbours'.
  [[nodiscard]] Vec3 confirmed_normal(std::uint32_t i) const noexcept {
    Vec3 sum = area_at(i).cast<double>();
    const Vec3 own = candidate_.normal[i].cast<double>();
    for (const std::uint32_t other : candidate_.near[i]) {
      if (other == i) break;
      Vec3 there = area_at(other).cast<double>();
      const double side = sum == Vec3::Zero() ? own.dot(there) : sum.dot(there);
      if (side < 0.0) there = -there;
      sum += kBesideShare * there;
    }
    const double size = sum.norm();
    return size > 0.0 ? Vec3(sum / size) : own;
  }

  /// Offers points to doubtful ones that lack them: points in whose rings the doubtful one is. A point in a
  /// sparse place is among the nearest of few.
  void offer() {
    const auto for_offers = [&](std::uint32_t i, auto&& use) {
      const Star& star = candidate_.star[i];
      for (std::uint32_t k = 0; k < star.size; ++k) {
        const std::uint32_t to = star.ring[k];
        if (slot_[to] != kNoPoint && candidate_.star.find(to, i) == candidate_.star.size(to)) use(slot_[to]);
      }
    };
    offers_begin_.assign(doubtful_.size() + 1, 0);
    for (const std::uint32_t i : doubtful_)
      for_offers(i, [&](std::uint32_t slot) { ++offers_begin_[slot + 1]; });
    std::partial_sum(offers_begin_.begin(), offers_begin_.end(), offers_begin_.begin());
    offers_.resize(offers_begin_.back());
    Points filled(offers_begin_.begin(), offers_begin_.end() - 1);
    for (const std::uint32_t i : doubtful_)
      for_offers(i, [&](std::uint32_t slot) { offers_[filled[slot]++] = i; });
  }

  /// Remakes the doubtful stars from what rises less than `steepest`. Returns the points with new stars and
  /// their old and new ring points.
  Points rebuild_star(double steepest) {
    repaired_.resize(doubtful_.size());
    std::vector<std::uint8_t> is_new(doubtful_.size(), 0);
    chunks(doubtful_.size(), [&](std::uint32_t d) {
      const std::uint32_t i = doubtful_[d];
      const Star& old = candidate_.star[i];
      const std::span<const std::uint32_t> offered(offers_.data() + offers_begin_[d],
                                                   offers_begin_[d + 1] - offers_begin_[d]);
      const PlanarLayout layout = candidate_.rough[i] != 0 ? PlanarLayout{candidate_.normal[i].cast<double>(),
                                                                          kRoughSteepest, false, true}
                                                           : PlanarLayout{confirmed_normal(i), steepest};
      Star made = star_in_plane(candidate_, i, layout, offered);
      const auto opened = [](const Star& s) { return s.size - s.sectors(); };
      if (opened(made) > opened(old)) return;
      made.agreed = agreed_sectors(candidate_, i, made);
      if (made.agreements() <= old.agreements()) return;
      repaired_[d] = candidate_.star.line_of(i, made);
      is_new[d] = 1;
    });
    std::vector<std::uint8_t> is_changed(candidate_.size(), 0);
    for (std::uint32_t d = 0; d < doubtful_.size(); ++d) {
      if (is_new[d] == 0) continue;
      mark_star(doubtful_[d], is_changed);
      candidate_.star.put_back(doubtful_[d], repaired_[d]);
      mark_star(doubtful_[d], is_changed);
    }
    return those_of_all([&](std::uint32_t i) { return is_changed[i] != 0; });
  }

  CandidateTriangulation& candidate_;
  std::vector<Vec3f> area_;                  ///< empty if few are doubtful
  UninitializedVector<std::uint32_t> slot_;  ///< by point: index among the numbered
  Points doubtful_;                          ///< ascending
  Points offers_begin_;                      ///< by slot
  Points offers_;
  std::vector<StarTable::Line> repaired_;  ///< by slot
};

}  // namespace

void repair_stars(CandidateTriangulation& candidate) {
  StarRepair(candidate).run();
}

}  // namespace palpate::local_delaunay
