// The few functions of Force Dimension's library that the plug-in calls, by their public names: for a library
// of ours that pretends to be it. Nothing here is the maker's text.
#pragma once

extern "C" {
int dhdGetDeviceCount();
int dhdOpenID(char index);
int dhdClose(char id);
int dhdEnableForce(unsigned char on, char id);
int dhdGetPosition(double* x_m, double* y_m, double* z_m, char id);
int dhdSetForce(double x_n, double y_n, double z_n, char id);
unsigned int dhdGetButtonMask(char id);
const char* dhdGetSystemName(char id);
const char* dhdErrorGetLastStr();
}
