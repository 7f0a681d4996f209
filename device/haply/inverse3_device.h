// Haply Inverse3, through the local service of its maker: the serial protocol below it is not public. Three
// degrees of freedom, forces of the service's frame; a thread of the link's own talks to the service, so that
// read and send never meet a socket.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "device/haply/inverse3_protocol.h"
#include "device/interface/device.h"
#include "device/links/http_request.h"
#include "device/links/packed_force.h"
#include "device/links/websocket_link.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/handover.h"

namespace palpate::device {

inline constexpr std::uint16_t kInverse3Port = 10001;  ///< of the service, WebSocket and HTTP, 3.1 and later

struct Inverse3Options {
  std::string name = "inverse3";
  std::string device_id;  ///< empty: the first that the service lists
  /// Both alter every force. They are set as they stand here, which is as the maker's examples have them, and
  /// recorded (facts).
  double force_gate = 0.3;
  bool torque_scaling = true;
  ServiceAddress service{"127.0.0.1", kInverse3Port, "/"};
  /// The middle of the workspace in the service's frame: a place of the maker's examples, well inside.
  Vec3 centre_mm = Vec3{0.0, -100.0, 200.0};
  /// Assumed, not measured: a part of what the maker advertises.
  DeviceLimits limits{
      5.0, {Vec3::Constant(-60.0), Vec3::Constant(60.0)}, 0.01, 1000.0, 1.0, 0.0, WorkspaceShape::kEllipsoid};
  int open_tries = 2000;       ///< waits for the first state
  std::function<void()> wait;  ///< between two; empty: a millisecond of sleep
  std::function<Result<HttpAnswer>(const HttpRequest&)> http = http_request;
};

/// What the service was told and what it says. The link's thread calls the TextPeer's functions, the device's
/// owner the others.
class Inverse3Talk final : public TextPeer {
 public:
  struct Seen {
    Vec3 position_mm = Vec3::Zero();
    std::uint32_t buttons = 0;
    std::int64_t packet_ns = 0;
  };

  Inverse3Talk(const Clock& clock, std::string wanted_id, double force_gate)
      : clock_(clock), wanted_id_(std::move(wanted_id)), force_gate_(force_gate) {}

  void take(std::string_view text) noexcept override;
  bool give(std::string& text) noexcept override;
  bool last(std::string& text) noexcept override;
  void disconnected() noexcept override { gone_.store(true); }

  /// The newest state that was not yet seen. Wait-free.
  [[nodiscard]] bool newest(Seen& seen) noexcept;
  /// Wait-free, from any thread.
  void force(const Vec3& force_n) noexcept { force_.store(force_n); }
  void zero() noexcept { force_.zero(); }
  /// Connected, and the device is listed.
  [[nodiscard]] bool present() const noexcept { return present_.load() && !gone_.load(); }
  [[nodiscard]] bool gone() const noexcept { return gone_.load(); }
  [[nodiscard]] int malformed_in_a_row() const noexcept { return malformed_.load(); }
  [[nodiscard]] std::uint64_t texts() const noexcept { return texts_.load(); }
  /// A force text with zero has left.
  [[nodiscard]] bool zero_given() const noexcept { return zero_given_.load(); }
  /// Once present(): they stay.
  [[nodiscard]] std::string device_id() const;
  [[nodiscard]] std::string config() const;

 private:
  const Clock& clock_;
  const std::string wanted_id_;
  const double force_gate_;
  PackedForce force_;
  Handover<Seen> seen_;
  std::atomic<bool> present_{false}, gone_{false}, zero_given_{false};
  std::atomic<int> malformed_{0};
  std::atomic<std::uint64_t> texts_{0};
  mutable std::mutex mutex_;  // of the two below: never in a frame
  std::string device_id_, config_;
  // The link's thread alone:
  bool gate_given_ = false, answer_due_ = false;
  std::int64_t given_ns_ = 0;
  Vec3 given_n_ = Vec3::Zero();
};

/// Owns its link. Between open and close one thread; cut_force any.
class Inverse3Device final : public Device {
 public:
  Inverse3Device(std::unique_ptr<TextLink> link, const Clock& clock, Inverse3Options options);
  ~Inverse3Device() override { close(); }

  [[nodiscard]] std::string name() const override { return options_.name; }
  /// Ready when the service has told a position, has been given a zero force, and its filters are set. An
  /// Error says what is missing: the service, the device, or sense.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override { return options_.limits; }
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;
  /// Takes effect when the link's thread next writes: within a millisecond where the service takes it.
  bool cut_force() noexcept override;

  /// Device, service, filters as they were set and as the service tells them.
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> facts() const { return facts_; }

 private:
  [[nodiscard]] Status wait_for_device();
  void set_scaling();
  void wait() const;

  std::unique_ptr<TextLink> link_;
  const Clock& clock_;
  Inverse3Options options_;
  // Never replaced while another thread may cut: kept from session to session, gone only with the device.
  std::vector<std::unique_ptr<Inverse3Talk>> talks_;
  std::atomic<Inverse3Talk*> talk_{nullptr};
  DeviceState state_;
  bool open_ = false;
  std::vector<std::pair<std::string, std::string>> facts_;
};

}  // namespace palpate::device
