// A network that is not there, between a bridge device and a far end, on a virtual clock: it loses, delays,
// repeats and garbles what it carries.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/force_governor.h>
#include "device/bridge/bridge_device.h"
#include "device/bridge/bridge_server.h"
#include "toolkit/core/random.h"

namespace palpate::device {

/// What the network does to one direction.
struct Weather {
  double loss = 0.0;                           ///< share of the datagrams
  double twice = 0.0;                          ///< share that comes again, at another time
  double garbled = 0.0;                        ///< share with flipped bits or another length
  double delay_s = 0.2e-3, jitter_s = 0.1e-3;  ///< uniform on top
  double straggler = 0.0;                      ///< share that comes `straggle_s` late
  double straggle_s = 0.5;
};

class PretendedNetwork {
 public:
  explicit PretendedNetwork(VirtualClock& clock, std::uint64_t seed = 1) : clock_(clock), random_(seed) {}

  using Bytes = std::vector<std::uint8_t>;
  struct Flying {
    std::int64_t due_ns;
    std::uint64_t order;
    Bytes bytes;
  };
  struct Way {
    Weather weather;
    std::vector<Flying> flying;
    std::vector<Bytes> kept;  ///< all that was ever sent, for who replays it
  };
  Way to_far, to_host;
  bool host_is_gone = false;  ///< its program died: nothing of it arrives

  void send(Way& way, std::span<const std::uint8_t> bytes) {
    way.kept.emplace_back(bytes.begin(), bytes.end());
    const int copies = random_.uniform() < way.weather.twice ? 2 : 1;
    for (int i = 0; i < copies; ++i) {
      if (random_.uniform() < way.weather.loss) continue;
      Bytes carried(bytes.begin(), bytes.end());
      if (random_.uniform() < way.weather.garbled) garble(carried);
      double late_s = way.weather.delay_s + way.weather.jitter_s * random_.uniform();
      if (random_.uniform() < way.weather.straggler) late_s += way.weather.straggle_s * random_.uniform();
      fly(way, std::move(carried), late_s);
    }
  }
  void fly(Way& way, Bytes bytes, double late_s) {
    way.flying.push_back({clock_.now_ns() + std::llround(1e9 * late_s), order_++, std::move(bytes)});
  }
  /// The next that has arrived; by time, then in the order of sending.
  bool take(Way& way, Bytes& bytes) {
    const auto next =
        std::min_element(way.flying.begin(), way.flying.end(), [](const auto& a, const auto& b) {
          return std::pair(a.due_ns, a.order) < std::pair(b.due_ns, b.order);
        });
    if (next == way.flying.end() || next->due_ns > clock_.now_ns()) return false;
    bytes = std::move(next->bytes);
    way.flying.erase(next);
    return true;
  }

 private:
  void garble(Bytes& bytes) {
    if (random_.below(4) == 0) {
      bytes.resize(random_.below(2 * bytes.size()));
      return;
    }
    for (std::uint64_t flips = 1 + random_.below(8); flips > 0; --flips)
      bytes[random_.below(bytes.size())] ^= static_cast<std::uint8_t>(1U << random_.below(8));
  }
  VirtualClock& clock_;
  Random random_;
  std::uint64_t order_ = 0;
};

class PretendedLink final : public Link {
 public:
  explicit PretendedLink(PretendedNetwork& network) : network_(network) {}
  Status open() override { return Done{}; }
  void close() noexcept override {}
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    if (!network_.host_is_gone) network_.send(network_.to_far, bytes);
    return true;
  }
  Polled poll(std::span<std::uint8_t> into) noexcept override {
    PretendedNetwork::Bytes bytes;
    if (!network_.take(network_.to_host, bytes)) return {};
    const std::size_t size = std::min(bytes.size(), into.size());
    std::copy_n(bytes.begin(), size, into.begin());
    return {size, false};
  }

 private:
  PretendedNetwork& network_;
};

class PretendedPort final : public DatagramPort {
 public:
  explicit PretendedPort(PretendedNetwork& network) : network_(network) {}
  std::size_t receive(std::span<std::uint8_t> into, Peer& from) noexcept override {
    PretendedNetwork::Bytes bytes;
    if (!network_.take(network_.to_far, bytes)) return 0;
    from.size = 1;
    const std::size_t size = std::min(bytes.size(), into.size());
    std::copy_n(bytes.begin(), size, into.begin());
    return size;
  }
  bool send(std::span<const std::uint8_t> bytes, const Peer&) noexcept override {
    network_.send(network_.to_host, bytes);
    return true;
  }

 private:
  PretendedNetwork& network_;
};

/// Stands at the far end: its position is set by hand, its motors hold what they were told last.
class HeldDevice final : public Device {
 public:
  explicit HeldDevice(const Clock& clock) : clock_(clock) {}
  [[nodiscard]] std::string name() const override { return "held"; }
  [[nodiscard]] Status open() override {
    held_n.setZero();
    return Done{};
  }
  void close() noexcept override { held_n.setZero(); }
  [[nodiscard]] DeviceLimits limits() const noexcept override {
    return {5.0,
            {Vec3::Constant(-80.0), Vec3::Constant(90.0)},
            0.02,
            1000.0,
            2.0,
            0.01,
            WorkspaceShape::kEllipsoid};
  }
  [[nodiscard]] DeviceState read() noexcept override {
    DeviceState now = state;
    now.packet_ns = clock_.now_ns();
    return now;
  }
  void send(GovernedForce force) noexcept override { held_n = force.newtons(); }
  bool cut_force() noexcept override {
    held_n.setZero();
    ++cuts;
    return true;
  }

  DeviceState state{.status = ReadStatus::kFresh};
  Vec3 held_n = Vec3::Zero();
  int cuts = 0;

 private:
  const Clock& clock_;
};

/// Host, network and far end at 1 kHz. The far end ticks half a period after the host.
struct BridgeRig {
  explicit BridgeRig(std::uint64_t seed = 1, const BridgeServerOptions& far_options = {})
      : network(clock, seed), port(network), far(held, port, clock, far_options) {
    BridgeOptions options{.name = "bridge:rig", .session = 0x1234'5678'9ABC'DEF0, .open_tries = 100};
    options.wait = [this] { pass(); };
    auto owned = std::make_unique<PretendedLink>(network);
    link = owned.get();
    device = std::make_unique<BridgeDevice>(std::move(owned), clock, options);
    EXPECT_TRUE(far.open().ok());
  }
  /// A period goes by, with a tick of the far end in its middle.
  void pass() {
    clock.advance(0.5e-3);
    if (far_ticks) far.tick();
    clock.advance(0.5e-3);
  }
  Status start() {
    const Status opened = device->open();
    if (!opened) return opened;
    GovernorOptions options{.slew_n_per_s = 1e6};
    governor.emplace(ForceGovernor::create(device->limits(), options).value());
    governor->arm(clock.now_s());
    return Done{};
  }
  /// One frame of the host: reads, governs, sends; then a period goes by.
  DeviceState frame(const Vec3& wanted_n) {
    const DeviceState seen = device->read();
    device->send(governor->govern(clock.now_s(), seen, wanted_n));
    pass();
    return seen;
  }
  void frames(int count, const Vec3& wanted_n) {
    for (int i = 0; i < count; ++i) frame(wanted_n);
  }

  VirtualClock clock;
  PretendedNetwork network;
  PretendedPort port;
  HeldDevice held{clock};
  BridgeServer far;
  PretendedLink* link = nullptr;
  std::unique_ptr<BridgeDevice> device;
  std::optional<ForceGovernor> governor;
  bool far_ticks = true;
};

}  // namespace palpate::device
