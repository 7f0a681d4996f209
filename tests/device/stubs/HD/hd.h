// The few functions of OpenHaptics' HD library that the plug-in calls, by their public names, with numbers of
// our own: for a library of ours that pretends to be it. Nothing here is the maker's text.
#pragma once

using HDenum = unsigned int;
using HDint = int;
using HDdouble = double;
using HDushort = unsigned short;
using HDstring = const char*;
using HDerror = unsigned int;
using HHD = unsigned int;
using HDSchedulerHandle = unsigned long;
using HDCallbackCode = unsigned int;

#define HDCALLBACK

struct HDErrorInfo {
  HDerror errorCode;
  int internalErrorCode;
  HHD hHD;
};

extern "C" {
using HDSchedulerCallback = HDCallbackCode(HDCALLBACK*)(void*);

HHD hdInitDevice(HDstring name);
void hdDisableDevice(HHD device);
void hdMakeCurrentDevice(HHD device);
void hdEnable(HDenum what);
void hdBeginFrame(HHD device);
void hdEndFrame(HHD device);
void hdGetDoublev(HDenum what, HDdouble* into);
void hdGetIntegerv(HDenum what, HDint* into);
void hdSetDoublev(HDenum what, const HDdouble* from);
HDstring hdGetString(HDenum what);
HDenum hdCheckCalibration();
HDSchedulerHandle hdScheduleAsynchronous(HDSchedulerCallback callback, void* data, HDushort priority);
void hdUnschedule(HDSchedulerHandle task);
void hdStartScheduler();
void hdStopScheduler();
HDErrorInfo hdGetError();
HDstring hdGetErrorString(HDerror code);
}

constexpr HDstring HD_DEFAULT_DEVICE = nullptr;
constexpr HHD HD_INVALID_HANDLE = 0xFFFFFFFFU;
constexpr HDerror HD_SUCCESS = 0;
constexpr HDCallbackCode HD_CALLBACK_CONTINUE = 1;
constexpr HDushort HD_MAX_SCHEDULER_PRIORITY = 7;
constexpr HDenum HD_CURRENT_POSITION = 1, HD_CURRENT_BUTTONS = 2, HD_CURRENT_FORCE = 3, HD_FORCE_OUTPUT = 4,
                 HD_NOMINAL_MAX_CONTINUOUS_FORCE = 5, HD_NOMINAL_MAX_STIFFNESS = 6,
                 HD_NOMINAL_MAX_DAMPING = 7, HD_USABLE_WORKSPACE_DIMENSIONS = 8, HD_DEVICE_MODEL_TYPE = 9,
                 HD_DEVICE_SERIAL_NUMBER = 10, HD_CALIBRATION_OK = 11, HD_CALIBRATION_NEEDS_UPDATE = 12;
