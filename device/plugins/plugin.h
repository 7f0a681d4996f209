// C interface to a plug-in for a maker's library. Palpate never links such a library: it loads the plug-in at
// run time, and `palpate list devices` reports missing ones. Plain C, for any compiler and age.
//
// Units: mm, N, s; right-handed device frame. A function may be called once the one before it in this list
// succeeded; none throws. Texts are UTF-8, zero-terminated, cut to size.
#pragma once

#include <stdint.h>  // NOLINT: C

#ifdef __cplusplus
extern "C" {
#endif

/// Increases when anything below changes its meaning; other plug-ins are not used.
#define PALPATE_PLUGIN_ABI 1u
/// The one symbol that a plug-in exports.
#define PALPATE_PLUGIN_ENTRY "palpate_plugin_entry"

typedef struct palpate_plugin_limits {  // NOLINT: C
  double force_max_n;                   ///< continuous, in any direction; above 0
  double low_mm[3], high_mm[3];         ///< workspace
  double resolution_mm;
  double rate_hz;
  double stiffness_max_n_per_mm;  ///< 0: unknown
  double damping_max_n_s_per_mm;  ///< 0: unknown
  uint32_t shape;                 ///< 0 box, 1 ellipsoid, 2 cylinder about z
  uint32_t reserved;
} palpate_plugin_limits;

typedef struct palpate_plugin_state {  // NOLINT: C
  double position_mm[3];
  int64_t age_ns;    ///< since measurement
  uint32_t status;   ///< 0 fresh, 1 nothing new, 2 garbled, 3 gone
  uint32_t homed;    ///< 1: homed
  uint32_t buttons;  ///< one bit each
  uint32_t reserved;
} palpate_plugin_state;

typedef struct palpate_plugin {  // NOLINT: C
  uint32_t abi;                  ///< PALPATE_PLUGIN_ABI
  uint32_t size;                 ///< of this struct
  const char* name;              ///< driver name, as in "NAME" or "NAME:1"
  const char* what;              ///< part of a sentence for people

  /// Number of connected devices; below 0: the library cannot work here. `text`: which devices, or why not.
  int32_t (*look)(char* text, uint32_t size);
  /// Opens the device of this index with zero force commanded. Null: `text` says why. The call may take long.
  void* (*open)(uint32_t index, char* text, uint32_t size);
  /// Commands zero and closes.
  void (*close)(void* device);
  /// 0: success.
  int32_t (*limits)(void* device, palpate_plugin_limits* limits);
  /// The newest state. 0: success. Never blocks or allocates.
  int32_t (*read)(void* device, palpate_plugin_state* state);
  /// Commands a force. 0: success. Never blocks or allocates. After 50 ms without a call the plug-in commands
  /// zero itself.
  int32_t (*send)(void* device, const double force_n[3]);
  /// Commands zero, from any thread at any time until close. 0: success. Never blocks or allocates.
  int32_t (*zero)(void* device);
  /// Facts of the device as lines "key=value". 0: success.
  int32_t (*facts)(void* device, char* text, uint32_t size);
} palpate_plugin;

/// Type of PALPATE_PLUGIN_ENTRY. The struct lives as long as the module.
typedef const palpate_plugin* (*palpate_plugin_entry_fn)(void);  // NOLINT: C

#ifdef __cplusplus
}
#endif
