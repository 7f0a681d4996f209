#include "toolkit/smooth/vouchers.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate::render {
namespace {

/// Rounding of places in shares of a patch.
constexpr double kShareRounding = 1e-9;

}  // namespace

void Vouchers::add(const Patch& patch) {
  if (!patch.filled.tells()) return;
  const Quadric& q = patch.quadric;
  const double per = 1.0 / patch.reached;
  const Vec3 d = middle_ - q.at;
  all_.push_back({q.u * per, q.v * per, d.dot(q.u) * per, d.dot(q.v) * per,
                  patch.filled.farthest() + kShareRounding, &patch});
}

bool Vouchers::vouch_for(const Vec3& foot) {
  for (Voucher& one : all_) {
    const double a = one.a + foot.dot(one.u), b = one.b + foot.dot(one.v);
    if (std::max(std::abs(a), std::abs(b)) > one.most) continue;
    const Patch& p = *one.patch;
    const Vec3 place = middle_ + foot, d = place - p.quadric.at;
    const double per = 1.0 / p.reached;
    if (std::abs(p.quadric.residual(place)) > p.spacing ||
        !p.filled.around(d.dot(p.quadric.u) * per, d.dot(p.quadric.v) * per))
      continue;
    std::swap(one, all_.front());  // asked first for the next place
    return true;
  }
  return false;
}

}  // namespace palpate::render
