/* SPDX-License-Identifier: Apache-2.0 */
/* build_program FILE: builds OpenCL C 1.2 on the first device and prints the log if that fails. */
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <stdio.h>

static char text[1 << 20], report[1 << 16];

int main(int count, char **arguments)
{
  cl_platform_id platform;
  cl_device_id device;
  cl_context context;
  cl_program program;
  cl_int status;
  const char *source = text;
  FILE *file = count == 2 ? fopen(arguments[1], "r") : NULL;
  if (!file || fread(text, 1, sizeof text - 1, file) == 0) {
    printf("cannot read the source\n");
    return 2;
  }
  fclose(file);
  if (clGetPlatformIDs(1, &platform, NULL) || clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, 1, &device, NULL)) {
    printf("SKIP: no OpenCL device\n");
    return 77;
  }
  context = clCreateContext(NULL, 1, &device, NULL, NULL, &status);
  program = clCreateProgramWithSource(context, 1, &source, NULL, &status);
  status = clBuildProgram(program, 1, &device, "-cl-std=CL1.2", NULL, NULL);
  clGetProgramBuildInfo(program, device, CL_PROGRAM_BUILD_LOG, sizeof report, report, NULL);
  printf("clBuildProgram: %d\n%s\n", status, report);
  return status == CL_SUCCESS ? 0 : 1;
}
