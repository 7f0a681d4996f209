#include "baselines/reconstruct/pole_labels.h"

#include <algorithm>
#include <cmath>
#include <queue>

namespace palpate::baselines {
namespace {

/// Links by the pole they start at, each in both directions.
struct Graph {
  struct To {
    std::uint32_t pole;
    float confidence;
    bool opposite;
  };
  std::vector<std::size_t> first;
  std::vector<To> to;

  Graph(std::size_t poles, std::span<const PoleLink> links) : first(poles + 1, 0), to(2 * links.size()) {
    for (const PoleLink& link : links) {
      ++first[link.a + 1];
      ++first[link.b + 1];
    }
    for (std::size_t i = 1; i < first.size(); ++i) first[i] += first[i - 1];
    std::vector<std::size_t> next(first.begin(), first.end() - 1);
    for (const PoleLink& link : links) {
      to[next[link.a]++] = {link.b, link.confidence, link.opposite};
      to[next[link.b]++] = {link.a, link.confidence, link.opposite};
    }
  }
};

struct Belief {
  float in = 0.0F, out = 0.0F;
  bool done = false;

  /// The paper's priority: one-sided beliefs by their strength, contradicting ones after all of them.
  [[nodiscard]] float priority() const noexcept {
    return in > 0.0F && out > 0.0F ? std::abs(in - out) - 1.0F : std::max(in, out);
  }
};

struct PoleEntry {
  float priority;
  std::uint32_t pole;
  bool operator<(const PoleEntry& other) const noexcept {
    return priority != other.priority ? priority < other.priority : pole > other.pole;
  }
};

}  // namespace

std::vector<bool> label_poles(std::size_t poles, std::span<const PoleLink> links,
                              std::span<const std::uint32_t> outside) {
  const Graph graph(poles, links);
  std::vector<Belief> beliefs(poles);
  std::priority_queue<PoleEntry> queue;
  for (const std::uint32_t pole : outside) {
    beliefs[pole].out = 1.0F;
    queue.push({1.0F, pole});
  }
  std::vector<bool> inside(poles, false);
  while (!queue.empty()) {
    const auto [priority, pole] = queue.top();
    queue.pop();
    Belief& own = beliefs[pole];
    // An entry is out of date once a belief has changed; a newer one stands for it then.
    if (own.done || priority != own.priority()) continue;
    own.done = true;
    inside[pole] = own.in > own.out;
    const float sure = std::max(own.in, own.out);
    for (std::size_t i = graph.first[pole]; i < graph.first[pole + 1]; ++i) {
      const Graph::To& link = graph.to[i];
      Belief& other = beliefs[link.pole];
      if (other.done) continue;
      float& belief = inside[pole] != link.opposite ? other.in : other.out;
      const float told = sure * link.confidence;
      if (told <= belief) continue;
      belief = told;
      queue.push({other.priority(), link.pole});
    }
  }
  return inside;
}

}  // namespace palpate::baselines
