#include "toolkit/smooth/cube_faces.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

namespace palpate::render {
namespace {

/// Points of a face, in its patches in a cube: three of the smallest.
constexpr int kFewestOfFace = 45;
/// Two patches of one sheet are one surface where they lie within so many spacings, or standard deviations,
/// of each other with normals within 25 degrees: the other side of a thin wall has the opposite one.
constexpr double kSameSpacings = 0.4, kSameSigmas = 3.0, kSameFacing = 0.9;
/// Few points do not join what so many times as many tell apart: by equal ones rough places of scans are
/// torn.
constexpr int kMuchMore = 4;
constexpr int kSameFootSteps = 2;
/// A place of a patch is hidden where the sheet passes it by a spacing, what a crease in noise is off by, or
/// by so many standard deviations, and a face where more than this share of its places are.
constexpr double kHiddenSpacings = 1.0, kHidden = 0.25;
constexpr std::uint32_t kNoMember = 0xffffffffu;

std::uint32_t root_of(std::vector<std::uint32_t>& root, std::uint32_t i) {
  while (root[i] != i) i = root[i] = root[root[i]];
  return i;
}
void join(std::vector<std::uint32_t>& root, std::uint32_t i, std::uint32_t j) {
  const std::uint32_t a = root_of(root, i), b = root_of(root, j);
  root[std::max(a, b)] = std::min(a, b);
}
double off_between(const Patch& a, const Patch& b) {
  return std::abs(a.quadric.residual(b.quadric.at)) + std::abs(b.quadric.residual(a.quadric.at));
}

/// Whether two patches are one surface where it is nearest to the middle of a cube.
bool same_surface(const Patch& a, const Patch& b, const Vec3& middle) {
  Vec3 at = middle;
  for (int i = 0; i < kSameFootSteps; ++i) at -= normal_at(a.quadric, at) * a.quadric.residual(at);
  if (normal_at(a.quadric, at).dot(normal_at(b.quadric, at)) < kSameFacing) return false;
  if (std::abs(b.quadric.residual(at)) >
      std::max(kSameSpacings * std::min(a.spacing, b.spacing), kSameSigmas * std::max(a.sigma, b.sigma)))
    return false;
  const auto reaches = [&](const Patch& p) {
    return (at - p.quadric.at).squaredNorm() <= p.support * p.support;
  };
  return reaches(a) && reaches(b);
}

}  // namespace

void CubeFaces::join_same(std::span<const std::uint32_t> members, const std::vector<Patch>& patches,
                          const PatchLinks& links, const Vec3& middle) {
  const std::uint32_t first = root_of(sheet_, 0);
  const auto same = [&](std::uint32_t i) { return root_of(sheet_, i) == first; };
  std::uint32_t one = 1;
  while (one < members.size() && same(one)) ++one;
  if (one == members.size()) return;
  for (std::uint32_t i = 0; i < members.size(); ++i)
    for (std::uint32_t j = 0; j < i; ++j) {
      if (root_of(sheet_, i) == root_of(sheet_, j) || links.sheet[members[i]] != links.sheet[members[j]])
        continue;
      const Patch &a = patches[members[i]], &b = patches[members[j]];
      if (!same_surface(a, b, middle)) continue;
      join(sheet_, i, j);
      join(face_, i, j);
    }
}

void CubeFaces::part(std::span<const std::uint32_t> members, const std::vector<Patch>& patches,
                     const PatchLinks& links, const Vec3& middle, double half) {
  number_.resize(patches.size(), kNoMember);
  if (all_go_on(members, patches, links)) {
    sheet_.assign(members.size(), 0);
    face_ = body_ = sheet_;
    return;
  }
  sheet_.resize(members.size());
  std::iota(sheet_.begin(), sheet_.end(), 0u);
  face_ = sheet_;
  creases_.clear();
  doubtful_.clear();
  goes_on_.clear();
  for (std::uint32_t i = 0; i < members.size(); ++i) number_[members[i]] = i;
  for (std::uint32_t i = 0; i < members.size(); ++i) {
    const std::uint32_t from = links.begin[members[i]], past = links.begin[members[i] + 1];
    for (std::uint32_t link = from; link < past; ++link) {
      const std::uint32_t to = links.to[link];
      if (to < members[i]) continue;  // told from there
      const std::uint32_t j = number_[to];
      if (j == kNoMember) continue;
      join(sheet_, i, j);
      const Patch &a = patches[members[i]], &b = patches[to];
      const int points = std::min(a.points, b.points);
      if (links.turn[link] != Turn::kNone)
        creases_.push_back({i, j, links.turn[link], points});
      else if (a.sure == b.sure)
        goes_on_.push_back({i, j, Turn::kNone, points});
      else
        doubtful_.push_back(a.sure ? Doubtful{j, i, off_between(a, b)} : Doubtful{i, j, off_between(a, b)});
    }
  }
  for (const std::uint32_t member : members) number_[member] = kNoMember;
  join_faces();
  if (one_face()) return;
  join_same(members, patches, links, middle);
  for (std::uint32_t i = 1; i < members.size() && all_one_; ++i) join(sheet_, 0, i);
  for (std::uint32_t i = 0; i < members.size(); ++i) {
    sheet_[i] = root_of(sheet_, i);
    face_[i] = root_of(face_, i);
  }
  settle_doubtful();
  settle_small(members, patches);
  body_ = face_;
  if (!creases_.empty()) part_bodies();
  if (!all_one_) part_hidden(members, patches, middle, half);
}

bool CubeFaces::all_go_on(std::span<const std::uint32_t> members, const std::vector<Patch>& patches,
                          const PatchLinks& links) {
  if (links.creased.empty()) return false;
  for (const std::uint32_t member : members)
    if (links.creased[member] != 0) return false;
  for (const std::uint32_t member : members) number_[member] = 0;
  number_[members.front()] = kNoMember;  // as those that are reached
  reached_.assign(1, members.front());
  for (std::size_t k = 0; k < reached_.size() && reached_.size() < members.size(); ++k) {
    const std::uint32_t from = reached_[k];
    for (const std::uint32_t to : links.of(from)) {
      if (number_[to] == kNoMember || patches[to].sure != patches[from].sure) continue;
      number_[to] = kNoMember;
      reached_.push_back(to);
    }
  }
  for (const std::uint32_t member : members) number_[member] = kNoMember;
  return reached_.size() == members.size();
}

/// Of most cubes all patches are one face: then nothing else is to be told.
bool CubeFaces::one_face() {
  const std::uint32_t first = root_of(face_, 0);
  for (std::uint32_t i = 1; i < face_.size(); ++i)
    if (root_of(face_, i) != first) return false;
  sheet_.assign(face_.size(), first);
  face_ = body_ = sheet_;
  return true;
}

double CubeFaces::joined_distance(std::uint32_t sheet, std::span<const std::uint32_t> members,
                                  const std::vector<Patch>& patches, const Vec3& at) {
  weights_.assign(members.size(), 0.0);
  sums_.assign(members.size(), 0.0);
  for (std::uint32_t i = 0; i < members.size(); ++i) {
    if (sheet_[i] != sheet) continue;
    const Patch& p = patches[members[i]];
    const Vec3 d = at - p.quadric.at;
    const double along = d.dot(p.quadric.n);
    const double rest = patch_weight((d.squaredNorm() - along * along) / (p.support * p.support));
    if (!(rest > 0.0)) continue;
    const double off = p.quadric.residual(at), near = p.spacing * p.spacing + off * off;
    const double weight = p.trust * rest / (near * near);
    weights_[face_[i]] += weight;
    sums_[face_[i]] += weight * off;
  }
  double least = std::numeric_limits<double>::infinity();
  for (const Face& body : faces_) {
    if (body.sheet != sheet) continue;
    double most = -std::numeric_limits<double>::infinity();
    for (const Face& face : faces_)
      if (face.sheet == sheet && face.body == body.body && weights_[face.name] > 0.0)
        most = std::max(most, sums_[face.name] / weights_[face.name]);
    if (std::isfinite(most)) least = std::min(least, most);
  }
  return least;
}

double CubeFaces::hidden_share(const Face& face, std::span<const std::uint32_t> members,
                               const std::vector<Patch>& patches, const Vec3& middle, double half) {
  double all = 0.0, hidden = 0.0;
  for (std::uint32_t i = 0; i < members.size(); ++i) {
    if (face_[i] != face.name) continue;
    const Patch& p = patches[members[i]];
    if ((p.quadric.at - middle).cwiseAbs().maxCoeff() > half) continue;
    all += p.points;
    const double off = std::abs(joined_distance(face.sheet, members, patches, p.quadric.at));
    if (off > std::max(kHiddenSpacings * p.spacing, kSameSigmas * p.sigma)) hidden += p.points;
  }
  return all > 0.0 ? hidden / all : 0.0;
}

void CubeFaces::find_faces() {
  faces_.clear();
  for (std::uint32_t i = 0; i < face_.size(); ++i)
    if (std::none_of(faces_.begin(), faces_.end(), [&](const Face& f) { return f.name == face_[i]; }))
      faces_.push_back({face_[i], sheet_[i], body_[i]});
}

void CubeFaces::part_hidden(std::span<const std::uint32_t> members, const std::vector<Patch>& patches,
                            const Vec3& middle, double half) {
  find_faces();
  for (std::size_t rounds = faces_.size(); rounds > 1; --rounds) {
    const Face* worst = nullptr;
    double most = kHidden;
    for (const Face& face : faces_) {
      const bool alone = std::none_of(faces_.begin(), faces_.end(), [&](const Face& other) {
        return other.name != face.name && other.sheet == face.sheet;
      });
      if (alone) continue;
      const double share = hidden_share(face, members, patches, middle, half);
      if (!(share > most)) continue;
      most = share;
      worst = &face;
    }
    if (worst == nullptr) return;
    take_out(*worst);
    find_faces();
  }
}

/// A sheet is named by a member of its own.
void CubeFaces::take_out(const Face& face) {
  const std::uint32_t name = face.name, sheet = face.sheet;
  std::uint32_t first = kNoMember, own = kNoMember;
  for (std::uint32_t i = 0; i < face_.size(); ++i) {
    if (face_[i] == name)
      own = std::min(own, i);
    else if (sheet_[i] == sheet)
      first = std::min(first, i);
  }
  for (std::uint32_t i = 0; i < face_.size(); ++i)
    if (face_[i] == name)
      sheet_[i] = own;
    else if (sheet_[i] == sheet)
      sheet_[i] = first;
}

void CubeFaces::join_faces() {
  if (!creases_.empty())
    std::sort(goes_on_.begin(), goes_on_.end(), [](const Crease& x, const Crease& y) {
      return std::make_tuple(-x.points, x.a, x.b) < std::make_tuple(-y.points, y.a, y.b);
    });
  for (const Crease& on : goes_on_) {
    const std::uint32_t a = root_of(face_, on.a), b = root_of(face_, on.b);
    const bool parted = std::any_of(creases_.begin(), creases_.end(), [&](const Crease& c) {
      if (c.points <= kMuchMore * on.points) return false;
      const std::uint32_t x = root_of(face_, c.a), y = root_of(face_, c.b);
      return (x == a && y == b) || (x == b && y == a);
    });
    if (!parted) join(face_, a, b);
  }
}

void CubeFaces::settle_doubtful() {
  std::sort(doubtful_.begin(), doubtful_.end(), [](const Doubtful& x, const Doubtful& y) {
    return std::tie(x.patch, x.off, x.sure) < std::tie(y.patch, y.off, y.sure);
  });
  for (std::size_t i = 0; i < doubtful_.size(); ++i)
    if (i == 0 || doubtful_[i].patch != doubtful_[i - 1].patch)
      face_[doubtful_[i].patch] = face_[doubtful_[i].sure];
}

void CubeFaces::settle_small(std::span<const std::uint32_t> members, const std::vector<Patch>& patches) {
  weight_.assign(members.size(), 0);
  for (std::uint32_t i = 0; i < members.size(); ++i) weight_[face_[i]] += patches[members[i]].points;
  const auto give = [&](std::uint32_t from, std::uint32_t to) {
    weight_[to] += std::exchange(weight_[from], 0);
    std::replace(face_.begin(), face_.end(), from, to);
  };
  for (const Crease& c : creases_) {
    const std::uint32_t a = face_[c.a], b = face_[c.b];
    if (a == b || std::min(weight_[a], weight_[b]) >= kFewestOfFace) continue;
    give(weight_[a] < weight_[b] ? a : b, weight_[a] < weight_[b] ? b : a);
  }
  std::erase_if(creases_, [&](const Crease& c) { return face_[c.a] == face_[c.b]; });
  creased_.assign(members.size(), 0);
  for (const Crease& c : creases_) creased_[face_[c.a]] = creased_[face_[c.b]] = 1;
  for (std::uint32_t i = 0; i < members.size(); ++i) {
    const std::uint32_t face = face_[i];
    if (creased_[face] != 0) continue;
    std::uint32_t largest = face;
    for (std::uint32_t j = 0; j < members.size(); ++j)
      if (sheet_[j] == sheet_[i] && weight_[face_[j]] > weight_[largest]) largest = face_[j];
    if (largest != face) give(face, largest);
  }
}

void CubeFaces::part_bodies() {
  for (Crease& c : creases_) {
    c.a = face_[c.a];
    c.b = face_[c.b];
    if (c.a > c.b) std::swap(c.a, c.b);
  }
  std::sort(creases_.begin(), creases_.end(),
            [](const Crease& x, const Crease& y) { return x.a != y.a ? x.a < y.a : x.b < y.b; });
  for (std::size_t i = 0; i < creases_.size();) {
    int ridges = 0;
    std::size_t end = i;
    for (; end < creases_.size() && creases_[end].a == creases_[i].a && creases_[end].b == creases_[i].b;
         ++end)
      ridges += static_cast<int>(creases_[end].turn);
    if (ridges > 0) join(body_, creases_[i].a, creases_[i].b);
    i = end;
  }
  for (std::uint32_t& r : body_) r = root_of(body_, r);
}

}  // namespace palpate::render
