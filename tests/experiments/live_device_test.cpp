// Sessions on a driver's device: guarded, unplugged, armed again, killed.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "device/record/recording.h"
#include "experiments/live/assembly.h"
#include "experiments/live/live.h"
#include "experiments/live/recording_session.h"
#include "experiments/live/remote.h"
#include "tests/device/helpers.h"
#include "tests/device/rig.h"
#include "tests/experiments/live_device_rig.h"
#include "tests/experiments/program.h"
#include "tests/json_schema.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data,
                                      std::size_t size);  // tests/fuzz/fuzz_remote_json.cpp

namespace palpate::experiments {
namespace {

using nlohmann::json;
using Fault = device::LinkFault;

const char* const kBoardVariable = "PALPATE_TEST_BOARD";
constexpr auto kMoment = std::chrono::milliseconds(1);
using device::comes;

class LiveDevice : public InFolder {
 protected:
  LiveDevice() : plan_(in("board")) {}
  LiveArguments arguments(double seconds) const { return session_of("packets", in("out"), seconds); }
  /// The exit status; what was printed.
  int live(const LiveArguments& a) {
    ProgressBar progress;
    Context context{progress, "palpate live"};
    const ProcessOutcome run = captured([&] { return run_live_with(a, drivers_with(plan_), context); });
    out_ = run.out, err_ = run.err;
    return run.exit_code;
  }
  json document() const { return json::parse(file_text(in("out/live.json"))); }
  bool said(const std::string& words) const { return err_.find(words) != std::string::npos; }

  PacketsPlan plan_;
  std::string out_, err_;
};

TEST_F(LiveDevice, UnpluggedTenTimesInOneSessionOnAVirtualClock) {
  plan_.transport = "simulation";
  plan_.faults = {{Fault::Kind::kUnplugged, 2.5, 100.0}};
  plan_.fails_before_back = 2;
  LiveArguments a = arguments(36.5);
  a.accelerated = a.rearm = true;
  a.record = in("session.palrec");
  EXPECT_EQ(live(a), kExitOk) << err_;
  EXPECT_EQ(schema_violations(std::string(PALPATE_DOCS) + "/schemas/live.schema.json",
                              file_text(in("out/live.json"))),
            "");
  const json session = document();
  EXPECT_EQ(session["device"], "packets");
  EXPECT_EQ(session["replugged"], 10);
  EXPECT_EQ(session["faults"], 10);
  EXPECT_EQ(session["rearmed"], 10);
  EXPECT_EQ(session["fault_names"], json::array({"the device was lost"}));
  EXPECT_EQ(session["ticks"], 36'501) << "they go on while it is away";
  EXPECT_EQ(plan_.opened, 11);
  EXPECT_EQ(plan_.not_opened, 20);
  EXPECT_EQ(plan_.rounds_with_force, 11) << "after each arming";
  EXPECT_FALSE(plan_.board().holds_force());
  EXPECT_TRUE(said("plug it in again")) << err_;
  EXPECT_TRUE(said("is back")) << err_;
  EXPECT_EQ(session["guarded"], true);
  EXPECT_EQ(session["recording"]["written"], 36'501);
  // What the device says of itself is kept with the session.
  const json& notes = session["notes"];
  EXPECT_NE(std::find(notes.begin(), notes.end(), "filter: none of its own"), notes.end()) << notes;
  // What it counts is told of the session's end: it was opened again since.
  const std::string openings = "openings: " + std::to_string(plan_.opened);
  EXPECT_GT(plan_.opened, 1);
  EXPECT_NE(std::find(notes.begin(), notes.end(), openings), notes.end()) << notes;
  auto recording = value_of(device::Recording::open(a.record));
  device::RecordedTick tick;
  Result<bool> more = recording.next(tick);
  while (more && *more) more = recording.next(tick);
  ASSERT_TRUE(more) << more.error().message();
  const auto& kept = recording.notes();
  const auto is_kept = [&](const std::string& what) {
    return std::any_of(kept.begin(), kept.end(),
                       [&](const std::string& note) { return note.find(what) != std::string::npos; });
  };
  EXPECT_TRUE(is_kept("device: filter: none of its own"));
  EXPECT_TRUE(is_kept("device at the opening: openings: 1"));
  EXPECT_TRUE(is_kept("device: " + openings));
}

TEST_F(LiveDevice, AWorkerThatTakesLongStopsNoTick) {
  const device::Drivers drivers = drivers_with(plan_);
  SessionClock clock(false);
  const DeviceChoice choice = choose_device({}, drivers).value();
  SessionDevice device = SessionDevice::make(choice, clock.clock(), 1e-3).value();
  device.hold(device::resting_at(Vec3(0.0, 0.0, 5.0)));
  device::SpringPlane plane(0.5);
  SessionSettings settings;
  settings.seconds = 600.0;
  Assembly session(settings, clock, device, plane, {});
  struct Counter final : device::TickObserver {
    void took(const device::Tick&) noexcept override { ++ticks; }
    std::atomic<int> ticks{0};
  } counter;
  session.observe(counter);
  struct Long final : SessionTasks {
    Long(Counter& counter_in, Assembly& session_in) : counter(counter_in), session(session_in) {}
    void work(double /*now_s*/) override {
      if (ticked) return;
      const int before = counter.ticks;
      if (comes([&] { return counter.ticks > before + 100; })) ticked = true;
      session.request_stop();
    }
    void key(char /*pressed*/) override {}
    Counter& counter;
    Assembly& session;
    bool ticked = false;
  } tasks(counter, session);
  ProgressBar progress;
  ASSERT_TRUE(session.run(tasks, progress));
  EXPECT_TRUE(tasks.ticked);
}

TEST_F(LiveDevice, WhatIsUnprovenIsSaidAndSoIsHoming) {
  plan_.transport = "simulation";
  plan_.faults = {{Fault::Kind::kUnhomed, 0.0, 1.5}};
  LiveArguments a = arguments(4.0);
  a.accelerated = true;
  EXPECT_EQ(live(a), kExitOk) << err_;
  const json session = document();
  EXPECT_EQ(session["faults"], 0);
  EXPECT_EQ(session["unproven"].size(), 1u);
  const std::size_t unproven = err_.find("not confirmed by hardware: that its motors"),
                    homing = err_.find("does not know its zero"), homed = err_.find("knows its zero; force");
  ASSERT_NE(homed, std::string::npos) << err_;
  EXPECT_LT(unproven, homing);
  EXPECT_LT(homing, homed);
  EXPECT_EQ(plan_.rounds_with_force, 1);
  EXPECT_GT(session["renderers"][0]["contact_frames"], 500);
}

TEST_F(LiveDevice, WhatDoesNotOpenLeavesNothing) {
  plan_.opens = false;
  LiveArguments a = arguments(1.0);
  a.record = in("session.palrec");
  EXPECT_EQ(live(a), kExitBadInput);
  EXPECT_TRUE(said("plug it in")) << err_;
  EXPECT_FALSE(std::filesystem::exists(in("out/live.json")));
  EXPECT_FALSE(std::filesystem::exists(in("session.palrec")));
}

TEST_F(LiveDevice, ARealDeviceKeepsItsTimeAndIsArmedByAPerson) {
  const std::pair<const char*, void (*)(LiveArguments&)> wrong[] = {
      {"real time", [](LiveArguments& a) { a.accelerated = true; }},
      {"key r", [](LiveArguments& a) { a.rearm = true; }},
      {"force_n", [](LiveArguments& a) { a.device.options = {"mass=3"}; }},
      {"KEY=VALUE", [](LiveArguments& a) { a.device.options = {"force_n"}; }},
      {"none.toml", [](LiveArguments& a) { a.device.file = a.run.out + "/none.toml"; }}};
  for (const auto& [words, ask] : wrong) {
    LiveArguments a = arguments(1.0);
    ask(a);
    EXPECT_EQ(live(a), kExitBadInput);
    EXPECT_TRUE(said(words)) << err_;
  }
  EXPECT_EQ(plan_.opened, 0);
}

TEST_F(LiveDevice, RecordTakesItToo) {
  plan_.transport = "simulation";
  plan_.faults = {{Fault::Kind::kUnplugged, 2.5, 100.0}};
  RecordArguments a;
  a.scene = kSmallWaves;
  a.renderer = "cloud";
  a.device.device = "packets";
  a.seconds = 8.0;
  a.accelerated = a.json = true;
  a.out = in("one.palrec");
  a.load.threads = 1;
  ProgressBar progress;
  Context context{progress, "palpate live record"};
  testing::internal::CaptureStdout();
  const int status = run_record_with(a, drivers_with(plan_), context);
  const json said = json::parse(testing::internal::GetCapturedStdout());
  EXPECT_EQ(status, kExitOk);
  EXPECT_EQ(said["device"], "test:packets");
  EXPECT_EQ(said["written"], 8001);
  EXPECT_EQ(said["faults"], said["replugged"]);
  EXPECT_GE(said["replugged"], 2);
  EXPECT_GT(said["contact_ticks"], 500);
}

// A process of its own that presses through the whole of `palpate live` until it is killed.
TEST(LiveDeviceChild, DISABLED_Presses) {
  const char* const file = std::getenv(kBoardVariable);
  ASSERT_NE(file, nullptr);
  PacketsPlan plan(file, false);
  LiveArguments a = session_of("packets", std::string(file) + ".out", 600.0);
  constexpr double kKillAfterMs = 500.0;
  a.device.guard_kill_after_ms = kKillAfterMs;
  ProgressBar progress;
  Context context{progress, "palpate live"};
  FAIL() << run_live_with(a, drivers_with(plan), context);
}

class LiveDeviceDeath : public InFolder, public testing::WithParamInterface<int> {};

TEST_P(LiveDeviceDeath, EndsInMotorsThatAreLetGo) {
  const FileBoard shared(in("board"), true);
  const Environment board(kBoardVariable, in("board").c_str());
  std::vector<std::string> arguments = {"/proc/self/exe", "--gtest_also_run_disabled_tests",
                                        "--gtest_filter=LiveDeviceChild.DISABLED_Presses"};
  std::vector<char*> argv;
  for (std::string& one : arguments) argv.push_back(one.data());
  argv.push_back(nullptr);
  pid_t child = 0;
  ASSERT_EQ(::posix_spawn(&child, argv[0], nullptr, nullptr, argv.data(), environ), 0);
  EXPECT_TRUE(comes([&] { return shared.board().holds_force(); })) << "it presses";
  ::kill(child, GetParam());
  EXPECT_TRUE(comes([&] { return !shared.board().holds_force(); }));
  // It stays so: nobody is left who could command another one.
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_TRUE(WIFSIGNALED(status));
  EXPECT_TRUE(comes([&] { return !shared.board().holds_force(); }));
}

// SIGSTOP: it hangs, and the guard kills it.
INSTANTIATE_TEST_SUITE_P(Signals, LiveDeviceDeath, testing::Values(SIGKILL, SIGSTOP));

/// Sends datagrams to a session.
class Sender {
 public:
  explicit Sender(std::uint16_t port) : socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    to_.sin_family = AF_INET;
    to_.sin_port = htons(port);
    to_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  }
  Sender(const Sender&) = delete;
  Sender& operator=(const Sender&) = delete;
  ~Sender() { ::close(socket_); }
  void send(const std::string& bytes) const {
    ::sendto(socket_, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to_), sizeof to_);
  }

 private:
  int socket_;
  sockaddr_in to_{};
};

TEST(RemoteListener, CountsWhatIsNoCommandAndPassesOnWhatIs) {
  std::mutex mutex;
  std::vector<device::RemoteCommand> seen;
  auto listener = RemoteListener::start(ListenAddress{}, [&](const device::RemoteCommand& command) {
    const std::lock_guard lock(mutex);
    seen.push_back(command);
    return command.kind != device::RemoteCommand::Kind::kRearm;  // "nothing to arm"
  });
  ASSERT_TRUE(listener) << listener.error().message();
  const std::string where = (*listener)->where();
  ASSERT_TRUE(where.starts_with("127.0.0.1:"));
  const Sender sender(static_cast<std::uint16_t>(std::stoi(where.substr(where.rfind(':') + 1))));
  const std::vector<std::string> sent = {
      "{\"do\": \"switch\"}\n{\"do\": \"select\", \"renderer\": \"cloud\"}\n\n",
      std::string("/palpate/select\0,i\0\0\0\0\0\2", 24),
      "{\"do\": \"mark\", \"text\": \"here\"}",
      "{\"do\": \"rearm\"}",
      std::string("/palpate/switch\0,f\0\0\0\0\0\0", 24),  // a button let go
      "",
      "\xff\xfe\x00junk",
      "{\"do\": \"explode\"}",
      std::string(5000, '{'),
      std::string(2000, '['),
      "/palpate/switch",
  };
  for (const std::string& bytes : sent) sender.send(bytes);
  ASSERT_TRUE(comes([&] { return (*listener)->counts().packets == sent.size(); }));
  ASSERT_TRUE(comes([&] { return (*listener)->counts().bad == 6; })) << (*listener)->counts().bad;
  const RemoteCounts counts = (*listener)->counts();
  EXPECT_EQ(counts.commands, 4u);
  EXPECT_EQ(counts.refused, 1u);
  listener->reset();
  using Kind = device::RemoteCommand::Kind;
  ASSERT_EQ(seen.size(), 5u);
  EXPECT_EQ(seen[0].kind, Kind::kNext);
  EXPECT_EQ(seen[1].text, "cloud");
  EXPECT_EQ(seen[2].number, 2);
  EXPECT_EQ(seen[3].text, "here");
  EXPECT_EQ(seen[4].kind, Kind::kRearm);
}

TEST(RemoteJson, TheCorpusIsAnsweredWithoutHarmAndCommandsAreUnderstood) {
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(PALPATE_CORPUS "/remote_json")) {
    const std::string text = file_text(entry.path());
    // Bytes as text, and every cut of it.
    for (std::size_t size = 0; size <= text.size(); ++size)
      EXPECT_EQ(LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(text.data()), size), 0);
    ++files;
  }
  EXPECT_GE(files, 12);
  using Kind = device::RemoteCommand::Kind;
  EXPECT_EQ(command_of_json("{\"do\": \"rearm\", \"why\": 3}")->kind, Kind::kRearm);
  EXPECT_EQ(command_of_json("{\"do\": \"select\", \"renderer\": 2}")->number, 2);
  for (const char* wrong :
       {"", "{}", "[]", "3", "{\"do\": 3}", "{\"do\": \"select\"}", "{\"do\": \"switch\"} x",
        "{\"do\": \"select\", \"renderer\": 0}", "{\"do\": \"select\", \"renderer\": 1.5}",
        "{\"do\": \"select\", \"renderer\": \"\"}", "{\"do\": \"mark\", \"text\": 3}"})
    EXPECT_FALSE(command_of_json(wrong)) << wrong;
}

TEST(RemoteListener, AddressesAreNumbers) {
  EXPECT_EQ(parse_listen("7700")->port, 7700);
  EXPECT_EQ(parse_listen("7700")->host, "127.0.0.1");
  EXPECT_EQ(parse_listen("0.0.0.0:7700")->host, "0.0.0.0");
  for (const char* wrong : {"", "x", "70000", "-1", "host:7700", "1.2.3:7", ":7", "7700:", "1.2.3.4"})
    EXPECT_FALSE(parse_listen(wrong)) << wrong;
  EXPECT_FALSE(RemoteListener::start({"203.0.113.1", 7700}, [](const auto&) { return true; }))
      << "not an address of this machine";
}

TEST_F(LiveDevice, IsSwitchedOverTheNetwork) {
  LiveArguments a = arguments(600.0);
  a.device = {};
  a.run.renderers = "cloud,cloud-smooth";
  a.listen = "0";
  a.rearm = true;
  a.seconds = 3.0;
  a.record = in("session.palrec");
  // Its port stands on standard error, which is read once it ended: so a port that was free a moment ago.
  std::string where;
  {
    auto probe = RemoteListener::start({}, [](const auto&) { return true; });
    ASSERT_TRUE(probe);
    where = (*probe)->where();
  }
  a.listen = where;
  const Sender sender(static_cast<std::uint16_t>(std::stoi(where.substr(where.rfind(':') + 1))));
  std::atomic<bool> ended{false};
  std::thread program([&] {
    for (int i = 0; !ended; ++i) {
      sender.send(i % 2 == 0 ? "{\"do\": \"select\", \"renderer\": 2}"
                             : "{\"do\": \"mark\", \"text\": \"m\"}");
      sender.send("junk");
      std::this_thread::sleep_for(100 * kMoment);
    }
  });
  (void)live(a);
  ended = true;
  program.join();
  const json session = document();
  EXPECT_GT(session["remote"]["commands"], 0) << err_;
  EXPECT_GT(session["remote"]["bad"], 0);
  EXPECT_FALSE(session["marks"].empty());
  EXPECT_EQ(session["marks"][0]["text"], "m");
  bool by_program = false;
  for (const json& decision : session["decisions"])
    by_program = by_program || decision["source"] == "program";
  EXPECT_TRUE(by_program) << session["decisions"];
  std::uint64_t late = 0;
  for (const json& bin : session["lateness_histogram"]) late += bin["count"].get<std::uint64_t>();
  EXPECT_EQ(late, session["ticks"]);
}

}  // namespace
}  // namespace palpate::experiments
