// A library with the functions of Lab Streaming Layer that Palpate calls, with the parameters of its public
// headers (lsl/streaminfo.h, lsl/outlet.h and lsl/common.h of version 1.14): it writes what it is asked into
// the file that LSL_STUB_FILE names, and refuses what those headers would. Not liblsl.
#include <cstdint>
#include <cstdio>
#include <cstdlib>

// Opaque there: two types, so that a handle in the place of the other is seen.
struct lsl_streaminfo_struct_ {
  bool alive = false;
};
struct lsl_outlet_struct_ {
  bool alive = false;
};
using lsl_streaminfo = lsl_streaminfo_struct_*;
using lsl_outlet = lsl_outlet_struct_*;
enum lsl_channel_format_t : std::int32_t { cft_string = 3 };

namespace {

lsl_streaminfo_struct_ info;
lsl_outlet_struct_ outlet;
constexpr std::int32_t kArgumentError = -3;  // lsl_argument_error

void write_line(const char* what, const char* text, double number) {
  const char* const name = std::getenv("LSL_STUB_FILE");
  if (name == nullptr) return;
  if (std::FILE* const file = std::fopen(name, "a")) {
    std::fprintf(file, "%s;%s;%.6f\n", what, text, number);
    std::fclose(file);
  }
}

}  // namespace

extern "C" {

lsl_streaminfo lsl_create_streaminfo(const char* name, const char* type, std::int32_t channel_count,
                                     double nominal_srate, lsl_channel_format_t channel_format,
                                     const char* source_id) {
  write_line("name", name, channel_count);
  write_line("type", type, nominal_srate);
  write_line("source", source_id, channel_format);
  if (*name == '\0' || channel_count < 1 || nominal_srate < 0.0 || channel_format != cft_string)
    return nullptr;
  info.alive = true;
  return &info;
}
lsl_outlet lsl_create_outlet(lsl_streaminfo given, std::int32_t chunk_size, std::int32_t max_buffered) {
  write_line("outlet", "chunk", chunk_size);
  write_line("outlet", "buffered", max_buffered);
  if (given != &info || !info.alive || chunk_size < 0 || max_buffered < 0) return nullptr;
  outlet.alive = true;
  return &outlet;
}
std::int32_t lsl_push_sample_strt(lsl_outlet given, const char** data, double timestamp) {
  if (given != &outlet || !outlet.alive) return kArgumentError;
  write_line("sample", *data, timestamp);
  return 0;
}
double lsl_local_clock() {
  return 1000.0;
}
void lsl_destroy_outlet(lsl_outlet out) {
  write_line("end", out == &outlet && outlet.alive ? "outlet" : "a strange outlet", 0.0);
  outlet.alive = false;
}
void lsl_destroy_streaminfo(lsl_streaminfo given) {
  write_line("end", given == &info && info.alive ? "info" : "a strange info", 0.0);
  info.alive = false;
}

}  // extern "C"
