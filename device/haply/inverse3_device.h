// Haply Inverse3 through its maker's local service; the serial protocol below is not public. Three degrees of
// freedom, forces in the service's frame. The link's thread talks to the service; read and send use no
// socket.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/drivers.h>
#include <palpate/triple_buffer.h>
#include <palpate/vec.h>
#include "device/interface/driver_options.h"
#include "device/links/newest_command.h"
#include "device/links/service_link.h"

namespace palpate::device {

// Messages of the maker's local service for the Haply Inverse3 (format 3.1 and later). From the maker's
// public pages, version 3.5 (facts); not tried with a real service.

struct Inverse3Text {
  bool is_json = false;       ///< a JSON object
  bool has_device = false;    ///< the requested device is listed
  bool has_position = false;  ///< with three finite numbers
  std::string device_id;
  Vec3 position_mm = Vec3::Zero();  ///< in the service's frame
  std::uint32_t buttons = 0;        ///< a, b, c of a grip: bits 0 to 2
  std::string config;               ///< of the device, as JSON: only in a session's first text
  int devices = -1;                 ///< number of listed Inverse3; -1: not stated
};

/// Reads the data of device `wanted_id`; empty: the first listed. Never fails: missing data stay unset.
[[nodiscard]] Inverse3Text parsed_inverse3(std::string_view text, const std::string& wanted_id);

/// A force (N, service's frame) for one device. Zero if not finite.
[[nodiscard]] std::string inverse3_force_text(const std::string& device_id, const Vec3& force_n);
/// Sets the gain of the service's force gate, which weakens forces that make the device oscillate.
[[nodiscard]] std::string inverse3_gate_text(const std::string& device_id, double gain);
[[nodiscard]] std::string inverse3_scaling_body(bool on);

inline constexpr std::uint16_t kInverse3Port = 10001;  ///< of the service, WebSocket and HTTP, 3.1 and later

struct Inverse3Options {
  std::string name = "inverse3";
  std::string device_id;  ///< empty: the first listed
  /// Both alter every force. Defaults follow the maker's examples, are set at opening and recorded (facts).
  double force_gate = 0.3;
  bool torque_scaling = true;
  ServiceAddress service{"127.0.0.1", kInverse3Port, "/"};
  /// Middle of the workspace in the service's frame: from the maker's examples, well inside.
  Vec3 centre_mm = Vec3{0.0, -100.0, 200.0};
  /// Assumed, not measured: part of the advertised range.
  DeviceLimits limits{
      5.0, {Vec3::Constant(-60.0), Vec3::Constant(60.0)}, 0.01, 1000.0, 1.0, 0.0, WorkspaceShape::kEllipsoid};
  int open_tries = 2000;                            ///< waits for the first state
  std::function<void()> wait = [] { sleep_ms(); };  ///< between two
  std::function<Result<HttpAnswer>(const HttpRequest&)> http = http_request;
};

/// The conversation with the service. The link's thread calls the TextPeer functions, the device's owner the
/// others.
class Inverse3Session final : public TextPeer {
 public:
  struct Seen {
    Vec3 position_mm = Vec3::Zero();
    std::uint32_t buttons = 0;
    std::int64_t packet_ns = 0;
  };

  Inverse3Session(const Clock& clock, std::string wanted_id, double force_gate)
      : clock_(clock), wanted_id_(std::move(wanted_id)), force_gate_(force_gate) {}

  void take(std::string_view text) noexcept override;
  bool give(std::string& text) noexcept override;
  bool last(std::string& text) noexcept override;
  void disconnected() noexcept override { gone_.store(true); }

  /// The newest unseen state. Wait-free.
  [[nodiscard]] bool newest(Seen& seen) noexcept;
  /// Wait-free, any thread.
  void force(const Vec3& force_n) noexcept { force_.store(force_n); }
  void zero() noexcept { force_.zero(); }
  /// Connected, with the device listed.
  [[nodiscard]] bool present() const noexcept { return present_.load() && !gone_.load(); }
  [[nodiscard]] bool gone() const noexcept { return gone_.load(); }
  [[nodiscard]] int malformed_in_a_row() const noexcept { return malformed_.load(); }
  [[nodiscard]] std::uint64_t texts() const noexcept { return texts_.load(); }
  /// A zero force text was sent.
  [[nodiscard]] bool zero_sent() const noexcept { return zero_given_.load(); }
  /// Constant once present().
  [[nodiscard]] std::string device_id() const;
  [[nodiscard]] std::string config() const;

 private:
  const Clock& clock_;
  const std::string wanted_id_;
  const double force_gate_;
  PackedForce force_;
  TripleBuffer<Seen> seen_;
  std::atomic<bool> present_{false}, gone_{false}, zero_given_{false};
  std::atomic<int> malformed_{0};
  std::atomic<std::uint64_t> texts_{0};
  mutable std::mutex mutex_;  // guards the next two; never locked in a frame
  std::string device_id_, config_;
  // For the link's thread only:
  bool gate_given_ = false, answer_due_ = false;
  std::int64_t given_ns_ = 0;
  Vec3 given_n_ = Vec3::Zero();
};

/// Owns its link. One thread between open and close; cut_force from any.
class Inverse3Device final : public Device {
 public:
  Inverse3Device(std::unique_ptr<TextLink> link, const Clock& clock, Inverse3Options options);
  ~Inverse3Device() override { close(); }

  [[nodiscard]] std::string name() const override { return options_.name; }
  /// Succeeds when the service has sent a position, received a zero force, and its filters are set. An Error
  /// says what is missing: service, device or valid data.
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override { return options_.limits; }
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;
  /// Takes effect at the link thread's next write: within a millisecond if the service accepts it.
  bool cut_force() noexcept override;

  /// Device, service, and the filters as set and as reported by the service.
  [[nodiscard]] DeviceFacts facts() const { return facts_; }

 private:
  [[nodiscard]] Status wait_for_device();
  void set_scaling();

  std::unique_ptr<TextLink> link_;
  const Clock& clock_;
  Inverse3Options options_;
  // Never replaced while another thread may cut: talks stay until the device is destroyed.
  std::vector<std::unique_ptr<Inverse3Session>> talks_;
  std::atomic<Inverse3Session*> talk_{nullptr};
  DeviceState state_;
  bool open_ = false;
  DeviceFacts facts_;
};

/// "inverse3" or "inverse3:DEVICE_ID". Options: service=HOST:PORT, force-gate=0..1, torque-scaling=on|off,
/// centre-mm=X/Y/Z, force-max-n.
void register_inverse3_driver(Drivers& drivers);

}  // namespace palpate::device
