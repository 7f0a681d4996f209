// A link of which a test is the other side, and forces for devices under test.
#pragma once

#include <cstdint>
#include <cstring>
#include <deque>
#include <string>
#include <utility>
#include <vector>

#include <palpate/device/force_governor.h>
#include <palpate/device/link.h>

namespace palpate::device {

using TestBytes = std::vector<std::uint8_t>;

/// What came and what is to come. Outlives the link, so that a test sees what a destructor sent.
struct FakeWire {
  std::deque<TestBytes> incoming;  ///< a poll gives one, or as much of it as there is room for
  std::vector<TestBytes> sent;
  bool keeps_rest =
      false;  ///< of a packet that was too long for the room: a stream; else it is lost: reports
  bool gone = false, open = false, refuses = false, opens = true;
  int closed = 0;
  void give(TestBytes bytes) { incoming.push_back(std::move(bytes)); }
  void give(const std::string& text) { incoming.emplace_back(text.begin(), text.end()); }
  [[nodiscard]] std::string last_text() const {
    return sent.empty() ? "" : std::string(sent.back().begin(), sent.back().end());
  }
};

class FakeLink final : public Link {
 public:
  explicit FakeLink(FakeWire& wire) : wire_(wire) {}
  Status open() override {
    if (!wire_.opens) return Error{"there is nothing", "connect it"};
    wire_.open = true;
    return Done{};
  }
  void close() noexcept override {
    wire_.closed += wire_.open ? 1 : 0;
    wire_.open = false;
  }
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    if (!wire_.open || wire_.gone || wire_.refuses) return false;
    wire_.sent.emplace_back(bytes.begin(), bytes.end());
    return true;
  }
  Polled poll(std::span<std::uint8_t> into) noexcept override {
    if (!wire_.open || wire_.gone) return {0, true};
    if (wire_.incoming.empty()) return {0, false};
    TestBytes& first = wire_.incoming.front();
    const std::size_t size = std::min(into.size(), first.size());
    std::copy_n(first.begin(), size, into.begin());
    if (wire_.keeps_rest && size < first.size())
      first.erase(first.begin(), first.begin() + static_cast<std::ptrdiff_t>(size));
    else
      wire_.incoming.pop_front();
    return {size, false};
  }

 private:
  FakeWire& wire_;
};

/// A force as a governor lets it through, after its soft start; at most 100 N.
inline GovernedForce governed(const Vec3& newtons) {
  DeviceLimits limits{
      100.0, {Vec3::Constant(-100.0), Vec3::Constant(100.0)}, 0.01, 1000.0, 0.0, 0.0, WorkspaceShape::kBox};
  GovernorOptions options{.user_limit_n = 100.0};
  ForceGovernor governor = ForceGovernor::create(limits, options).value();
  governor.arm(0.0);
  DeviceState state{.status = ReadStatus::kFresh};
  for (int i = 0; i < 600; ++i) (void)governor.govern(i * 1e-3, state, newtons);
  return governor.govern(0.6, state, newtons);
}

inline std::int16_t word_of(const TestBytes& bytes, std::size_t word) {
  return static_cast<std::int16_t>(bytes.at(2 * word) | (bytes.at(2 * word + 1) << 8));
}

inline TestBytes words(std::initializer_list<int> values, std::size_t padded = 0) {
  TestBytes bytes;
  for (const int value : values) {
    bytes.push_back(static_cast<std::uint8_t>(value & 0xFF));
    bytes.push_back(static_cast<std::uint8_t>((value >> 8) & 0xFF));
  }
  if (padded > bytes.size()) bytes.resize(padded);
  return bytes;
}

}  // namespace palpate::device
