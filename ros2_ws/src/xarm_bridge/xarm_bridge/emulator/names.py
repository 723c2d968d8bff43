"""What the SDK calls the registers of the command port (`XCONF.UxbusReg` of xarm-python-sdk, in small letters)."""

_TABLE = """
1 get_version, 2 get_robot_sn, 3 check_verify, 4 reload_dynamics, 5 get_report_tau_or_i, 6 get_tcp_rotation_radius,
7 get_allow_approx_motion, 10 system_control, 11 motion_en, 12 set_state, 13 get_state, 14 get_cmdnum, 15 get_error,
16 clean_err, 17 clean_war, 18 set_brake, 19 set_mode, 21 move_line, 22 move_lineb, 23 move_joint, 24 move_jointb,
25 move_home, 26 sleep_instt, 27 move_circle, 28 move_line_tool, 29 move_servoj, 30 move_servo_cart, 31 set_tcp_jerk,
32 set_tcp_maxacc, 33 set_joint_jerk, 34 set_joint_maxacc, 35 set_tcp_offset, 36 set_load_param, 37 set_collis_sens,
38 set_teach_sens, 39 clean_conf, 40 save_conf, 41 get_tcp_pose, 42 get_joint_pos, 43 get_ik, 44 get_fk,
45 is_joint_limit, 46 is_tcp_limit, 47 set_reduced_trsv, 48 set_reduced_p2pv, 49 get_reduced_mode, 50 set_reduced_mode,
51 set_gravity_dir, 52 set_limit_xyz, 53 get_reduced_state, 54 set_servot, 55 get_joint_tau, 56 set_safe_level,
57 get_safe_level, 58 set_reduced_jrange, 59 set_fense_on, 60 set_collis_reb, 61 set_traj_record, 62 save_traj,
63 load_traj, 64 play_traj, 65 get_traj_rw_status, 66 set_allow_approx_motion, 67 get_dh, 68 set_dh, 69 get_movement,
70 report_tau_or_i, 71 set_timer, 72 cancel_timer, 73 set_world_offset, 74 cnter_reset, 75 cnter_plus,
76 cal_pose_offset, 77 set_self_collis_check, 78 set_collis_tool, 79 set_simulation_robot, 80 set_cartv_continue,
81 vc_set_jointv, 82 vc_set_cartv, 83 move_relative, 91 get_tcp_pose_aa, 92 move_line_aa, 93 move_servo_cart_aa,
101 servo_w16b, 102 servo_r16b, 103 servo_w32b, 104 servo_r32b, 105 servo_zero, 106 servo_dbmsg, 107 servo_error,
111 cali_tcp_pose, 112 cali_tcp_orient, 113 cali_wrld_orient, 114 cali_wrld_pose, 115 iden_fric, 123 tgpio_mb_tiout,
124 rs485_rtu, 125 tgpio_err, 127 tgpio_w16b, 128 tgpio_r16b, 129 tgpio_w32b, 130 tgpio_r32b, 131 cgpio_get_digit,
132 cgpio_get_analog1, 133 cgpio_get_analog2, 134 cgpio_set_digit, 135 cgpio_set_analog1, 136 cgpio_set_analog2,
137 cgpio_set_in_fun, 138 cgpio_set_out_fun, 139 cgpio_get_state, 140 get_pwr_version, 141 get_hd_types,
142 delayed_cgpio_set, 143 delayed_tgpio_set, 144 position_cgpio_set, 145 position_tgpio_set, 146 set_io_stop_reset,
147 position_cgpio_set_analog, 150 ftsensor_get_data_old, 200 ftsensor_get_data, 201 ftsensor_enable,
202 ftsensor_set_mode, 203 ftsensor_get_mode, 204 iden_load, 205 ftsensor_set_load_offset, 206 ftsensor_set_zero,
207 admittance_config, 208 force_ctrl_pid, 209 force_ctrl_config, 210 admittance_ctrl_mkb, 211 admittance_ctrl_config,
212 ftsensor_get_config, 230 get_traj_speeding, 231 get_max_joint_velocity, 232 set_common_param, 233 get_common_param,
234 get_common_info, 240 tgpio_com_tiout, 241 rs485_agent, 253 feedback_check, 254 set_feedback_type
"""

NAMES: dict[int, str] = {
    int(number): name for number, name in (entry.split() for entry in _TABLE.replace("\n", " ").split(","))
}


def register_title(register: int) -> str:
    """`register 40 (save_conf)`, or the number alone where the SDK has no name for it."""
    return f"register {register} ({NAMES[register]})" if register in NAMES else f"register {register}"
